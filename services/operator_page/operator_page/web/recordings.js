// What was recorded: found, reported, compared, verified, exported.
"use strict";
import { attempt, get, html, isOperator, post, say, state, useEffect, useState } from "/web/lab.js";
import { Table, dated } from "/web/parts.js";

export function RecordingsScreen() {
  const [asked, setAsked] = useState({ rig: "", target: "", result: "" });
  const [found, setFound] = useState(null);
  const [marked, setMarked] = useState([]);
  const [findings, setFindings] = useState({});
  const search = () => attempt(async () => setFound(await get(`/api/recordings?${new URLSearchParams(asked)}`)));
  const ended = state.lab.campaigns.filter((one) => one.ended).length;
  useEffect(() => { search(); }, [asked, ended]);
  const verify = async (id) => {
    setFindings((before) => ({ ...before, [id]: "reading it from end to end …" }));
    const answer = await attempt(() => post(`/api/recordings/${id}/verify`));
    const text = !answer ? "not verified" : answer.findings.length === 0 ? "✓ whole" : answer.findings.join(" ");
    setFindings((before) => ({ ...before, [id]: text }));
    if (answer) say(`${id}: ${answer.findings.length === 0 ? "whole, every checksum is right." : `${answer.findings.length} findings.`}`, answer.findings.length > 0);
  };
  const set = (key) => (event) => setAsked({ ...asked, [key]: event.target.value });
  const mark = (id) => (event) => setMarked(event.target.checked ? [...marked, id] : marked.filter((one) => one !== id));
  return html`<h1>Recordings</h1>
    <div class="row" role="search"><label>Rig <select value=${asked.rig} onChange=${set("rig")}><option value="">all</option>${state.lab.rigs.map((rig) => html`<option>${rig.name}</option>`)}</select></label>
      <label>Target contains <input value=${asked.target} onInput=${set("target")} /></label>
      <label>Result <select value=${asked.result} onChange=${set("result")}><option value="">all</option>${(found ? found.results : []).map((one) => html`<option>${one}</option>`)}</select></label>
      ${marked.length >= 2 ? html`<a class="button" target="_blank" rel="noopener" href=${`/api/comparison?${marked.map((id) => `id=${encodeURIComponent(id)}`).join("&")}`}>Compare ${marked.length}</a>` : html`<p>Mark two or more to compare them.</p>`}</div>
    ${found && html`<${Table} caption=${`${found.found} recordings, the newest first${found.found > found.recordings.length ? `; ${found.recordings.length} are shown` : ""}`}
      heads=${["recording", "report", "export of the best playback", "verify", "result", "begun", "rig", "target", "size"]}
      rows=${found.recordings.map((one) => [html`<label class="choice"><input type="checkbox" checked=${marked.includes(one.id)} onChange=${mark(one.id)} disabled=${!one.closed} /> ${one.id}</label>`,
        one.closed ? html`<a href=${`/api/recordings/${one.id}/report`} target="_blank" rel="noopener">report</a>` : "–",
        one.closed ? html`<span class="links"><a href=${`/api/recordings/${one.id}/export/drive/rsp`} download>drive</a> <a href=${`/api/recordings/${one.id}/export/response/rsp`} download>response</a> <a href=${`/api/recordings/${one.id}/export/target/rsp`} download>target</a></span>` : "–",
        one.closed && isOperator() ? (findings[one.id] ? html`<span class="wrapped">${findings[one.id]}</span>` : html`<button type="button" onClick=${() => verify(one.id)}>Verify</button>`) : "–",
        one.closed ? one.result : `${one.result}, still written`, one.begun ? dated(one.begun) : "–", one.rig, html`<div class="wrapped long">${one.target}</div>`, `${(one.bytes / 1e6).toFixed(1)} MB`])} />`}`;
}
