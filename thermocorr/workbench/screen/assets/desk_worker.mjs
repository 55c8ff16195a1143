// The desk in a worker: Pyodide, the package, and messages of JSON. All files come from the folder of the page.
let py;
let base;
let ready = false;
let left = false; // whether a turn is to come
const queue = [];

async function boot() {
  self.postMessage({ began: "loading Python" });
  const { loadPyodide } = await import(new URL("pyodide/pyodide.mjs", base).href);
  py = await loadPyodide({ indexURL: new URL("pyodide/", base).href, lockFileURL: new URL("pyodide/pyodide-lock.json", base).href });
  self.postMessage({ began: "loading numpy, scipy, pandas, scikit-learn and matplotlib" });
  await py.loadPackage(["numpy", "scipy", "pandas", "scikit-learn", "matplotlib"]);
  py.unpackArchive(await (await fetch(new URL("packages.zip", base))).arrayBuffer(), "zip");
  py.registerJsModule("screen", { tell: (text) => self.postMessage(JSON.parse(text)) });
  self.postMessage({ began: "loading thermocorr" });
  await py.runPythonAsync(`
import json, os, warnings
os.environ["MPLBACKEND"] = "svg"
warnings.simplefilter("ignore")
import screen
from thermocorr.workbench.screen.desk import Desk
os.makedirs("/log", exist_ok=True)
desk = Desk(None, lambda message: screen.tell(json.dumps(message, allow_nan=False)), chores=False)
def hear(text):
    desk.hear(json.loads(text))
def chore():
    return desk.chore()
`);
  ready = true;
  self.postMessage({ began: "ready" });
  turn();
}

function hear({ message, along }) {
  if (along) py.FS.writeFile(`/log/${along.name}`, new Uint8Array(along.bytes));
  py.globals.get("hear")(JSON.stringify(message));
}

function turn() { // what is asked comes first; else what is not known yet is found out, one thing at a time
  const next = queue.shift();
  try {
    if (next) { hear(next); left = true; }
    else left = py.globals.get("chore")();
  } catch (error) { failed(error, next); left = queue.length > 0; }
  if (left || queue.length) { left = true; setTimeout(turn); }
}

function failed(error, asked) {
  const problem = String(error.message ?? error).trim().split("\n").pop();
  if (asked) self.postMessage({ kind: "failed", number: asked.message.number, problem });
  self.postMessage({ kind: "progress", content: { text: "" } });
}

self.onmessage = ({ data }) => {
  if (data.base) {
    base = data.base;
    boot().catch((error) => { self.postMessage({ broken: `The page cannot start: ${error.message ?? error}` }); });
    return;
  }
  queue.push(data);
  if (ready && !left) { left = true; setTimeout(turn); }
};
