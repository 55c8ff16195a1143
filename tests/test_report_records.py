"""Pages of a refinement, of long records, of runs that overlap, of logs in files, and the command's."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from browser import complaints, numbers, opened, series

from thermocorr import DynamicBiasRegressor, ParquetLog, refine
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.pages import Answer, PageData, page
from thermocorr.pages.report import write_report


def test_a_refinement_shows_before_and_after(browser, tmp_path):
    record = make_record(1500, effects=[("covariate", 4.0, {"column": "humidity"})], seed=2)
    X, y = record.drop(columns="reading"), record["reading"]
    refinement = refine(DynamicBiasRegressor("temperature", ["5 min", "1 h"]), X, y, max_steps=1)
    assert len(refinement.steps) > 1
    refinement.save_html(tmp_path / "refinement.html")
    opened(browser, tmp_path / "refinement.html")
    assert complaints(browser) == []
    expected = refinement.steps[["later_rms", "held_out_rms", "rms", "db", "low", "high"]].to_numpy()
    found = numbers(browser, ".steps")
    assert found[0] == expected[0, :3].tolist()
    assert found[1:] == expected[1:].tolist()
    before, after = browser.execute_script("return thermocorr.charts.refined.panels.map(u => u.data[1])")
    for drawn, diagnosis in zip((before, after), (refinement.diagnoses[0], refinement.diagnoses[-1]), strict=True):
        assert np.sqrt(np.mean(np.square(drawn))) == pytest.approx(diagnosis.residual_rms, rel=1e-5)
    scales = browser.execute_script(
        "return thermocorr.charts.refined.panels.map(u => [u.scales.y.min, u.scales.y.max])"
    )
    assert scales[0] == scales[1]
    assert "<script" not in refinement._repr_html_()


def test_a_long_record_opens_quickly_and_is_small(browser, tmp_path, voltage):
    X, y = voltage
    model = DynamicBiasRegressor("temperature", ["2 min", "1 h"]).fit(X, y)
    path = write_report(tmp_path / "long.html", model, X, y, unjudged="Not judged: the test is about the page.")
    assert path.stat().st_size < 5e6
    opened(browser, path)
    ready = int(browser.execute_script("return document.documentElement.dataset.ready"))
    assert ready < 8000  # [ms]; 0.6 s on an idle core; shared machines are slower
    assert series(browser, 1, 1)[1].size == len(X)  # nothing thinned out at this length


def test_runs_that_overlap_in_time_stand_one_after_the_other(browser, tmp_path):
    rng = np.random.default_rng(0)
    parts = [
        pd.DataFrame(
            {"s": np.arange(600) * 10.0 + start, "run": run, "temperature": 20 + np.cumsum(rng.normal(0, 0.1, 600))}
        )
        for run, start in (("a", 0.0), ("b", 5.0), ("c", 100_000.0))
    ]
    X = pd.concat(parts, ignore_index=True)
    model = DynamicBiasRegressor("temperature", ["5 min"], time="s", run="run").fit(X, 2 * X["temperature"])
    data = PageData.of(model, X, 2 * X["temperature"])
    assert not data.timeline.in_order
    path = tmp_path / "overlap.html"
    path.write_text(page(data, Answer()), encoding="utf-8")
    opened(browser, path)
    assert complaints(browser) == []
    x, _ = series(browser, 1, 1)
    assert (np.diff(x) >= 0).all() and x[-1] < 2 * 1800 * 10  # the long pause before run c is left out
    told = browser.execute_script("const c = thermocorr.charts.series; return c.when(c.x[c.x.length - 1], 1)")
    unit = {"s": 1.0, "min": 60.0, "h": 3600.0}[told.split()[1]]
    assert float(told.split()[0]) * unit == pytest.approx(X["s"].iloc[-1], rel=1e-5)  # its true time is told


def test_a_log_in_a_file_is_read_block_by_block(tmp_path):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow: pip install '.[parquet]'")
    record = make_record(5000, seed=1)
    record.to_parquet(tmp_path / "log.parquet")
    log = ParquetLog(tmp_path / "log.parquet")
    model = DynamicBiasRegressor("temperature", ["5 min", "1 h"]).fit(log, log["reading"])
    whole = PageData.of(model, record, record["reading"], most=1000)
    pieces = PageData.of(model, log, log["reading"], most=1000)
    assert pieces.traces.rows_per_cell == whole.traces.rows_per_cell > 1
    for name, values in whole.traces.columns.items():
        np.testing.assert_allclose(pieces.traces.columns[name], values, rtol=1e-12, atol=1e-12)
    path = write_report(tmp_path / "out" / "report.html", model, log, log["reading"])
    assert "<h2>The record</h2>" in path.read_text(encoding="utf-8")


def test_the_command_writes_the_report(tmp_path, capsys):
    record = make_record(1500, seed=5).reset_index()
    log = tmp_path / "a'b <i>.csv"
    record.to_csv(log, index=False)
    report = tmp_path / "sub" / "page.html"
    options = ["--reading", "reading", "--time-constants", "10min,2h", "--quiet", "--blocks", "2"]
    assert main(["analyze", str(log), *options, "--report", str(report)]) == 0
    assert f"Written: page.html in {report.parent}" in capsys.readouterr().out.replace("\n  ", "")
    html = report.read_text(encoding="utf-8")
    assert "Static and dynamic" in html and "thermocorr analyze" in html and "<i>.csv" not in html
    assert main(["analyze", str(log), *options, "--report", str(tmp_path)]) == 2  # a folder
    assert "cannot be written" in capsys.readouterr().err
