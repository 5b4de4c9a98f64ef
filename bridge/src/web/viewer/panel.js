// The cards: processes with their lamps, counters, objects. Each update rewrites its own rows and keeps no history.

import { COST_LETHAL, COST_UNKNOWN } from "./protocol.js";

const $ = (id) => document.getElementById(id);
const AGE_MAX_MS = 2000, ROWS_MAX = 100;

function text(className, content, tag = "span") {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.textContent = content;
  return made;
}

function lamp(state) {
  const made = text(`lamp ${state}`, "");
  made.title = state;
  return made;
}

const hz = (value) => (value >= 99.5 ? value.toFixed(0) : value >= 9.95 ? value.toFixed(0) : value.toFixed(1));
export const age = (ms) => (ms == null ? "–" : ms < 950 ? `${Math.round(ms)} ms` : ms < 99500 ? `${(ms / 1000).toFixed(1)} s` : `${Math.round(ms / 60000)} min`);
const metres = (value, digits = 1) => (Number.isFinite(value) ? `${value.toFixed(digits)} m` : "–");
const centimetres = (value) => (Number.isFinite(value) ? `${(value * 100).toFixed(0)} cm` : "–");

export function showProcesses({ graph, processes }) {
  $("graph").textContent = graph ? `graph ${graph}` : "";
  $("processes").replaceChildren(...processes.map((process) => {
    const item = document.createElement("li"), row = text("row", "", "div");
    item.className = process.state;
    const rates = process.state === "running" || process.in_hz || process.out_hz ? `${hz(process.in_hz ?? 0)} → ${hz(process.out_hz ?? 0)} Hz` : process.state;
    row.append(lamp(process.state), text("name", process.name), text("numbers", rates));
    item.append(row);
    const state = process.state === "running" ? "" : `${process.state}: `;
    const restarts = process.restarts ? ` · ${process.restarts} restart${process.restarts > 1 ? "s" : ""}` : "";
    if (state || process.reason || restarts) item.append(text("reason", state + process.reason + restarts, "div"));
    const drops = Object.entries(process.dropped).map(([cause, n]) => `${n} × ${cause}`).join(", ") || "none";
    item.title = `pid ${process.pid}, ${((process.cpu ?? 0) * 100).toFixed(0)} % of a core, ${(process.rss_bytes / 1048576).toFixed(0)} MB\n` +
      `newest data ${age(process.age_ms)} old\ndropped: ${drops}`;
    return item;
  }));
}

export function showCounters(counters, frames) {
  const item = (name, value, title = "", old = false) => {
    const made = text(old ? "old" : "", `${name} `);
    made.append(text("", value, "b"));
    made.title = title;
    return made;
  };
  const dropped = Object.entries(counters.dropped);
  const ages = Object.entries(counters.age_ms).filter(([layer]) => layer !== "detections");
  $("counters").replaceChildren(
    item("beams/s", counters.beams_per_s.toLocaleString("en")),
    item("scans/s", counters.scans_per_s.toFixed(0)),
    item("voxels", counters.voxels.toLocaleString("en"), `${counters.blocks} blocks, snapshot ${counters.snapshot}`),
    text("", "ages:"),
    ...ages.map(([layer, ms]) => item(layer, age(ms), `age of the newest ${layer}`, ms > AGE_MAX_MS)),
    item("dropped", dropped.reduce((sum, [, n]) => sum + n, 0).toLocaleString("en"),
      dropped.map(([cause, n]) => `${n} × ${cause}`).join("\n") || "nothing dropped by the bridge"),
    item("viewers", counters.clients),
    item("frames/s", frames.toFixed(0)));
}

export function showObjects(objects, vehicle, choose) {
  const near = (object) => Math.hypot(object.place[0] - vehicle[0], object.place[1] - vehicle[1]);
  const rows = [...objects.list].sort((a, b) => near(a) - near(b)).slice(0, ROWS_MAX);
  $("object-count").textContent = `${objects.list.length} reported, ${objects.stored} in store${objects.truncated ? ", cut" : ""}`;
  $("objects").replaceChildren(...rows.map((object) => {
    const row = document.createElement("tr");
    row.classList.toggle("chosen", object.id === objects.chosen);
    const cells = [object.id, object.what, centimetres(object.dbhM), object.confidence.toFixed(1), metres(near(object))];
    row.append(...cells.map((cell) => text("", cell, "td")));
    row.onmouseenter = () => choose(object.id);
    row.onmouseleave = () => choose(null);
    return row;
  }));
}

export function objectTip(object) {
  const plus = (value, std, show) => `${show(value)}${Number.isFinite(std) && Number.isFinite(value) ? ` ± ${show(std)}` : ""}`;
  return [
    `${object.what} ${object.id}`,
    `confidence ${object.confidence.toFixed(2)} from ${object.sightings} sighting${object.sightings === 1 ? "" : "s"}`,
    `${object.what === "tree" ? "DBH" : "across"} ${plus(object.dbhM, object.dbhStdM, centimetres)} · height ${metres(object.heightM)}`,
    `E ${object.place[0].toFixed(2)}  N ${object.place[1].toFixed(2)} ± ${centimetres(object.stdM)}`,
    `last seen ${age(Math.max(0, object.ageS) * 1000)} before this`,
  ];
}

const dense = (cell) => (cell.density === null ? "" : `, ${cell.density} % of it filled`);

export function cellTip(cell, place) {
  const cost = cell.cost === COST_UNKNOWN ? "unknown" : cell.cost === COST_LETHAL ? `never (${cell.reason})` : `${cell.cost} of 253 (${cell.reason})`;
  return [
    `${cell.what}${cell.vegetation > 0 ? `, ${cell.vegetation.toFixed(1)} m of vegetation${dense(cell)}` : ""}`,
    `traversability cost ${cost}`,
    cell.ground === null ? "no ground known" : `ground ${cell.ground.toFixed(2)} m, ${cell.evidence}`,
    `E ${place[0].toFixed(1)}  N ${place[1].toFixed(1)}`,
  ];
}

export function showTip(lines, x, y) {
  const tip = $("tip");
  tip.hidden = !lines;
  if (!lines) return;
  const [first, ...rest] = lines;
  tip.replaceChildren(text("", first, "b"), ...rest.map((line) => text("", line, "div")));
  tip.style.transform = `translate(${Math.min(x + 16, innerWidth - tip.offsetWidth - 8)}px, ${Math.min(y + 14, innerHeight - tip.offsetHeight - 8)}px)`;
}

// The lamp of the connection itself, and a banner while it is down.
export function showConnection({ state, text: reason, retryAtMs, heardMs }) {
  const [light, what] = $("connection").children;
  light.className = `lamp ${state}`;
  what.textContent = reason;
  document.body.classList.toggle("cut-off", state === "failed");
  $("banner").hidden = state !== "failed";
  if (state !== "failed") return;
  const seconds = Math.max(0, Math.ceil((retryAtMs - Date.now()) / 1000));
  const old = heardMs ? ` What is drawn is ${age(Date.now() - heardMs)} old.` : "";
  $("banner").textContent = `${reason[0].toUpperCase()}${reason.slice(1)}: trying again in ${seconds} s.${old}`;
}
