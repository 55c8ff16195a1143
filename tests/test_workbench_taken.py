"""What is taken away from the workbench comes to the same model."""

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from benches import settled, stretch

from thermocorr import load_model
from thermocorr.datasets import make_record
from thermocorr.files.codec import ModelFileError
from thermocorr.interactive.acts import guessed
from thermocorr.interactive.bench import Bench
from thermocorr.interactive.snapshots import snapshot
from thermocorr.interactive.source import effects_in, opened
from thermocorr.interactive.takeaway import KINDS, past_node, taken, with_past
from thermocorr.interactive.tiles import Store
from thermocorr.readers import Options
from thermocorr.records import RecordError

pytestmark = pytest.mark.newest

OWN = '''
import numpy as np
from thermocorr.effects import Effect, EffectInfo

class Fan(Effect):
    """A fan that comes on above 5 V."""
    kind = "fan"
    info = EffectInfo(physics="A fan.", bench_check="Stop it.", formula="fan", parameters={})
    def __init__(self, column="supply"):
        self.column = column
    def inputs(self):
        return [self.column]
    @classmethod
    def candidates(cls, record, columns=None):
        return [cls(c) for c in (columns or ()) if c == "supply"]
    def names(self):
        return ["fan"]
    def signals(self, x):
        return [x.where(x[self.column] >= 5.0, 1.0, 0.0)]
'''


def taken_script(bench, folder):
    bench.start()
    return taken(bench, "script", folder).read_text()


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::thermocorr.RecordWarning")
def test_the_script_and_the_model_file_come_to_the_same_model(bench, tmp_path):
    bench.perform({"do": "add", "suspect": 0})
    bench.perform({"do": "leave_out", **stretch(bench, 0.2, 0.25)})
    bench.perform({"do": "shape", "time_constants": "4", "degree": 2, "products": False})
    settled(bench)
    out = tmp_path / "out"
    out.mkdir()
    files = {kind: taken(bench, kind, out) for kind in KINDS}
    wanted = bench.current.model
    tail = "\nimport json\nprint(json.dumps([model.intercept_, *model.coef_.tolist()]))\n"
    (out / "run.py").write_text(files["script"].read_text(encoding="utf-8") + tail, encoding="utf-8")
    done = subprocess.run([sys.executable, out / "run.py"], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[-1]) == [wanted.intercept_, *wanted.coef_.tolist()]
    held_out = snapshot(bench)["history"][-1]["held_out"]["value"]
    assert f"held out {held_out:.6g}" in done.stdout
    np.testing.assert_array_equal(load_model(files["model"]).coef_, wanted.coef_)
    corrected = pd.read_csv(files["corrected"])
    assert len(corrected) == 3000 and {"corrected", "flag", "u"} <= set(corrected.columns)
    assert "<!DOCTYPE html>" in files["report"].read_text(encoding="utf-8")[:100]


def test_steps_that_are_none_are_refused(bench):
    def acts(act):
        return {"acts": [act], "versions": [[0]], "at": 0}

    backwards = {"do": "leave_out", "rows": [[5, 2]], "where": ""}
    past = past_node(bench.past)
    for node, sentence in (
        (acts({"do": "dance"}), "is no step"),
        (acts(backwards), "ends before"),
        ({**past, "at": 7}, "past.at"),
        ({**past, "versions": [[99]]}, "versions"),
        ({**past, "versions": []}, "nothing"),
        (1, "an object"),
    ):
        with pytest.raises(ModelFileError, match=sentence):
            with_past(bench, node)


def test_several_files_are_runs(bench_log, tmp_path):
    frame = pd.read_csv(bench_log)
    frame["time"] = pd.to_datetime(frame["time"]) + pd.Timedelta("90 days")
    frame.to_csv(tmp_path / "later.csv", index=False)
    source = opened([bench_log, tmp_path / "later.csv"])
    bench = Bench(source, Store(tmp_path), roles=guessed(source.frame))
    bench.start()
    assert bench.problem == "" and bench.arrangement().roles.run == "file"
    assert len(bench.store.get(bench.current.curves["begins"])) == 2
    place = bench.store.get(bench.current.curves["place"])
    assert place[-1] < 0.2 * 90 * 86_400  # the long pause is left out of the axis
    script = taken(bench, "script", tmp_path).read_text()
    space = {}
    exec(script.split("# How large")[0], space)
    np.testing.assert_array_equal(space["model"].coef_, bench.current.model.coef_)


@pytest.mark.long
def test_an_effect_from_a_file_is_a_suspect_and_comes_into_the_script(tmp_path):
    path = tmp_path / "fan_of_the_test.py"
    path.write_text(OWN)
    own = effects_in(path)
    assert [cls.kind for cls in own] == ["fan"]
    record = make_record(3000, effects={"covariate": 0.0}, seed=3)
    record["reading"] += 2.0 * record.attrs["noise"] * (record["supply"] >= 5.0)
    record.to_csv(tmp_path / "fan.csv")
    source = opened([tmp_path / "fan.csv"])
    bench = Bench(source, Store(tmp_path), roles=guessed(source.frame), own=own, own_file=str(path))
    bench.start()
    first = snapshot(settled(bench))["judged"]["suspects"][0]
    assert first["cause"] and first["label"].startswith("fan")
    bench.perform({"do": "add", "suspect": 0})
    script = taken(bench, "script", tmp_path)
    tail = "\nimport json\nprint(json.dumps(model.coef_.tolist()))\n"
    (tmp_path / "run.py").write_text(script.read_text() + tail)
    done = subprocess.run([sys.executable, tmp_path / "run.py"], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[-1]) == bench.current.model.coef_.tolist()
    for content, sentence in (
        ("x = 1", "defines no effect"),
        ("1/0", "ZeroDivisionError"),
        ("class", "SyntaxError"),
        ("exit()", "SystemExit"),
    ):
        broken = tmp_path / "broken_effects.py"
        broken.write_text(content)
        with pytest.raises(RecordError, match=sentence):
            effects_in(broken)


def test_the_corrected_log_lacks_the_rows_that_were_left_out(tmp_path):
    record = make_record(600, seed=1).reset_index()[["time", "temperature", "reading"]]
    doubled = pd.concat([record, record[100:103]]).sort_values("time", kind="stable")
    doubled.to_csv(tmp_path / "log.csv", index=False)
    source = opened([tmp_path / "log.csv"], Options(skip_bad_rows=True))
    bench = Bench(source, Store(tmp_path), roles=guessed(source.frame))
    bench.start()
    written = pd.read_csv(taken(bench, "corrected", tmp_path))
    assert written["time"].tolist() == record["time"].astype(str).tolist() and written["corrected"].notna().all()
