// What the page knows of the lab, and how it asks: one stream of events, one way to send a command.
"use strict";

export const html = self.htm.bind(self.preact.h);
export const { useEffect, useRef, useState } = self.preactHooks;

const VERSION = document.querySelector("meta[name=duralab-page]").content;
const LOST_AFTER = 2.5; // seconds without an event; said within 3 s
const MOST_LINES = 500;
const PASSED_AFTER = 20000; // milliseconds

export const state = {
  session: null, lab: null, log: [], signals: {}, targets: {}, described: {},
  live: false, reload: false, rig: sessionStorage.getItem("rig") || "", said: null, attempt: "", theme: localStorage.getItem("theme") || "",
};
const listeners = new Set();
let scheduled = false;

export function changed() {
  if (scheduled) return;
  scheduled = true;
  setTimeout(() => { scheduled = false; listeners.forEach((listen) => listen()); }, 40);
}

// The rig that STOP means: only a person, or what a person begins, changes it; a reload keeps it.
export function chooseRig(rig) {
  state.rig = rig;
  sessionStorage.setItem("rig", rig);
  changed();
}

export function useLab() {
  const [, draw] = useState(0);
  useEffect(() => {
    const listen = () => draw((n) => n + 1);
    listeners.add(listen);
    return () => listeners.delete(listen);
  }, []);
  return state;
}

export class Refused extends Error {}

async function read(answer) {
  const document = await answer.json().catch(() => ({ error: `The service answered ${answer.status}.` }));
  if (answer.status === 401 && state.session && state.session.name) signedOut();
  if (document.field === "version") { state.reload = true; changed(); }
  if (!answer.ok) throw Object.assign(new Refused(document.error), { field: document.field, status: answer.status });
  return document;
}

const lost = () => { throw new Refused("The page has no contact with its service; nothing was done."); };

export async function get(path) {
  return read(await fetch(path, { headers: { "X-Duralab-Page": VERSION } }).catch(lost));
}

export async function post(path, values = {}, also = {}) {
  const headers = { "Content-Type": "application/json", "X-Duralab-Page": VERSION };
  if (state.session && state.session.token) headers["X-Duralab-Token"] = state.session.token;
  const body = JSON.stringify({ ...values, ...also });
  return read(await fetch(path, { method: "POST", headers, body }).catch(lost));
}

export async function send(path, content) {
  const headers = { "Content-Type": "application/octet-stream", "X-Duralab-Page": VERSION, "X-Duralab-Token": state.session.token };
  return read(await fetch(path, { method: "POST", headers, body: content }).catch(lost));
}

// Two acts: the first names what is to be done, the second does it.
export const arm = (action, values) => post("/api/arm", { action, values }, { seen: state.lab.now });
export const act = (action, values, word) => post(action, values, { word, seen: state.lab.now });

export async function stop(rig) {
  say(`Stop of ${rig || "all rigs"} sent …`);
  try {
    answered("Stop", await post(rig ? `/api/rigs/${rig}/stop` : "/api/stop", {}));
  } catch (error) {
    say(`The stop did not reach the lab: ${error.message} Use the emergency stop.`, true);
  }
}

// What was done is old news after a while; trouble, a stop, and what is being made ready stay until they are over.
export function say(text, trouble = false, about = {}) {
  const said = { ...about, text, trouble };
  state.said = said;
  changed();
  if (!trouble && said.stopped === undefined && !said.rig) setTimeout(() => { if (state.said === said) { state.said = null; changed(); } }, PASSED_AFTER);
}

const modeOf = (name) => state.lab.rigs.find((one) => one.name === name)?.mode;

export function answered(label, answer) {
  const { rig } = answer;
  if (answer.rests !== undefined) say(`${rig || "All rigs"}: ${answer.rests ? "stopped, at rest" : "stop sent, not at rest yet"}.`, false, { stopped: rig });
  else if (answer.attempt) say(`${label}: accepted, being made ready.`, false, { rig, mode: modeOf(rig) });
  else say(`${label}: ${answer.activity === undefined ? "done" : "accepted"}.`);
  state.attempt = answer.attempt || "";
  bringUpToDate();
}

// The answer to a command while it is true: the log reports how an attempt went, and the rig whether it is at rest.
function bringUpToDate() {
  const line = state.attempt && state.log.find((one) => one.attempt === state.attempt);
  if (line) { state.attempt = ""; say(line.text, line.trouble); return; }
  const { said } = state;
  if (said?.rig && modeOf(said.rig) !== said.mode) state.said = null;
  if (said?.stopped === undefined) return;
  const stopped = state.lab.rigs.filter((one) => !said.stopped || one.name === said.stopped);
  const latched = stopped.length > 0 && stopped.every((one) => one.mode === "interlocked");
  if (latched && !said.latched) say(`${said.stopped || "All rigs"}: stopped, at rest.`, false, { ...said, latched });
  if (!latched && said.latched) state.said = null;
}

export async function attempt(work) {
  try { return await work(); } catch (error) {
    if (!(error instanceof Refused)) throw error;
    say(error.message, true);
    return undefined;
  }
}

export const isOperator = () => state.session && state.session.role === "operator";
export const mayMove = () => state.live && isOperator() && !state.reload;

// The stream. Its events carry the service's time; one that waited on its way, as in a browser that slept, is old.
let source = null;
let heard = -Infinity;
let offset = Infinity;

const seconds = () => performance.timeOrigin / 1000 + performance.now() / 1000;

function isOld(sent) {
  const ahead = Date.now() / 1000 - sent;
  offset = Math.min(offset, ahead);
  return ahead - offset > LOST_AFTER;
}

function listen() {
  if (source) source.close();
  heard = -Infinity;
  offset = Infinity;
  source = new EventSource("/api/stream");
  // After a break the service sends everything again: nothing of before is kept.
  source.addEventListener("open", () => { state.log = []; state.signals = {}; offset = Infinity; });
  source.addEventListener("lab", (event) => {
    const document = JSON.parse(event.data);
    if (document.version !== VERSION) state.reload = true;
    if (isOld(document.now)) { setLive(false); return; }
    state.log = [...state.log, ...document.log].slice(-MOST_LINES);
    state.lab = document;
    bringUpToDate();
    const names = document.rigs.map((rig) => rig.name);
    if (!state.rig && names.length) chooseRig(busiest(document) || names[0]);
    heard = seconds();
    setLive(true);
    changed();
  });
  source.addEventListener("signals", (event) => { take(JSON.parse(event.data)); changed(); });
  source.addEventListener("ended", signedOut);
  source.addEventListener("error", () => {
    if (source.readyState === EventSource.CLOSED) setTimeout(refresh, 1000);
  });
}

const busiest = (document) => (document.campaigns.find((one) => !one.ended) || document.endurance.find((one) => !one.ended) || document.rigs.find((one) => one.run) || {}).rig;

function setLive(live) {
  if (state.live !== live) { state.live = live; changed(); }
}

setInterval(() => { if (seconds() - heard > LOST_AFTER) setLive(false); }, 200);

function take(part) {
  const known = state.signals[part.rig];
  const same = known && known.run === part.run && known.bucket_seconds === part.bucket_seconds && part.first > 0;
  const run = same ? known : { run: part.run, bucket_seconds: part.bucket_seconds, response: [[], []], drive: [[], []] };
  for (const kind of ["response", "drive"]) {
    for (const side of [0, 1]) {
      part[kind][side].forEach((values, row) => {
        const before = run[kind][side][row] || [];
        run[kind][side][row] = before.slice(0, part.first).concat(values);
      });
    }
  }
  run.over = part.over;
  run.changes = (run.changes || 0) + 1;
  state.signals[part.rig] = run;
}

export function described(rig) {
  if (rig && !(rig in state.described)) {
    state.described[rig] = null;
    get(`/api/rigs/${rig}`).then((found) => { state.described[rig] = found; changed(); }, () => { delete state.described[rig]; });
  }
  return state.described[rig];
}

export function targetOf(id) {
  if (!(id in state.targets)) {
    state.targets[id] = null;
    get(`/api/campaigns/${id}/target`).then((found) => { state.targets[id] = found; changed(); },
      () => setTimeout(() => { delete state.targets[id]; }, 2000));
  }
  return state.targets[id];
}

function signedOut() {
  if (source) source.close();
  state.session = null;
  setLive(false);
  changed();
  refresh();
}

export async function refresh() {
  try {
    state.session = await get("/api/session");
    if (state.session.version !== VERSION) state.reload = true;
    if (state.session.name) listen();
  } catch (error) {
    setTimeout(refresh, 1000);
  }
  changed();
}

export async function signIn(name, password) {
  state.session = await post("/api/sign_in", { name, password });
  state.lab = null;
  await refresh();
}

export async function signInByCertificate() {
  state.session = await post("/api/sign_in_by_certificate");
  state.lab = null;
  await refresh();
}

export async function signOut() {
  await attempt(() => post("/api/sign_out"));
  signedOut();
}
