// Where data come from: the server, or the page itself where one run was written into one file.
import { Tape, readOn } from "./tape.js";

const decoded = (id) => {
  const text = atob(document.getElementById(id).textContent);
  return Uint8Array.from(text, (sign) => sign.charCodeAt(0));
};

export const mailed = document.getElementById("run-data")
  ? JSON.parse(new TextDecoder().decode(decoded("run-data")))
  : null;

async function get(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

const query = (id) => encodeURIComponent(id);
export const recordingAddress = (id) => `/recording?id=${query(id)}`;
export const summary = () => (mailed ? { kind: "run", name: mailed.name, run: mailed.name } : get("/api/summary"));
export const runs = () => get("/api/runs");
export const where = (condition) => get(`/api/where?where=${query(condition)}`);
export const csvAddress = (condition) => `/api/runs.csv?where=${query(condition)}`;
export const run = (id) => (mailed ? mailed.run : get(`/api/run?id=${query(id)}`));

export async function tapeOf(id, onProgress) {
  const tape = new Tape();
  if (mailed) tape.feed(decoded("run-recording"));
  else await readOn(tape, recordingAddress(id), 0, onProgress);
  return tape;
}
