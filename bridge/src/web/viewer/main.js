// The page: frames come in, a picture goes out. It draws when something changed and not otherwise, holds the newest
// state only, and so needs the same memory after a day as after a minute.

import { Camera, rayThrough } from "./camera.js";
import { CANDIDATE, OBJECT, SCAN } from "./colours.js";
import { Connection } from "./connection.js";
import { attachGestures } from "./gestures.js";
import { context } from "./gl.js";
import { Grid } from "./grid.js";
import { installHook } from "./hook.js";
import { legend, swatch } from "./legend.js";
import { Objects } from "./objects.js";
import { cellTip, objectTip, showConnection, showCounters, showObjects, showProcesses, showTip } from "./panel.js";
import { VERSION, decode } from "./protocol.js";
import { pacer } from "./pace.js";
import { pickGround } from "./pick.js";
import { Scans } from "./scan.js";
import { Solids } from "./solids.js";
import { Vehicle } from "./vehicle.js";
import { Voxels } from "./voxels.js";
import { World } from "./world.js";

const $ = (id) => document.getElementById(id);
const CUT_NONE_M = 12;
// Layers of the picture, and the layer of the stream without which each is empty.
const LAYERS = {
  voxels: ["Voxels", "map"], ground: ["Ground", "grid"], objects: ["Objects", "objects", OBJECT], detections: ["Candidates", "detections", CANDIDATE],
  scan: ["Scan", "points", SCAN], fan: ["Beams", "points"], vehicle: ["Vehicle", "vehicle"],
};

const canvas = $("scene");
const gl = contextOrWords();
const world = new World(), solids = new Solids(gl), grid = new Grid(gl), voxels = new Voxels(gl), scans = new Scans(gl);
const vehicle = new Vehicle(solids), objects = new Objects(solids, $("labels"));
const layers = Object.fromEntries(Object.keys(LAYERS).map((name) => [name, true]));
const look = { byHeight: false, overlay: "none", cutM: Infinity, heights: [0, 1], grid };
const state = { frames: 0, decodeErrors: 0, snapshot: null, drawnSnapshot: null, connection: null, pointer: [-1, -1], view: null };
let framesShown = 0, framesPerS = 0;

const requestDraw = pacer(gl, draw);
const camera = new Camera(requestDraw);
const connection = new Connection(onFrame, onConnection);

function contextOrWords() {
  try {
    return context(canvas);
  } catch (error) {
    $("banner").textContent = error.message;
    $("banner").hidden = false;
    throw error;
  }
}

function onFrame(buffer) {
  try {
    const frame = decode(buffer);
    receive[frame.kind](frame);
  } catch (error) {
    state.decodeErrors++;
    console.error(error);
  }
  requestDraw();
}

const receive = {
  hello: ({ json }) => {
    if (json.protocol !== VERSION) throw new Error(`protocol ${json.protocol}, this page speaks ${VERSION}: reload it`);
    voxels.blockVoxels = json.block_voxels;
    vehicle.size = json.vehicle;
    $("graph").title = json.software;
  },
  block: (frame) => voxels.put(frame),
  commit: (frame) => {
    voxels.keep(frame.keys);
    state.snapshot = frame.snapshot;
  },
  points: (frame) => scans.put(frame),
  grid: (frame) => grid.put(frame),
  objects: (frame) => {
    objects.put(frame);
    showObjects(objects, vehicle.frame ? vehicle.place : frame.origin, choose);
  },
  detections: (frame) => objects.putDetections(frame),
  vehicle: (frame) => {
    vehicle.frame = frame;
    const place = vehicle.place, before = world.origin;
    if (world.vehicleAt(place, 2 * frame.zone + frame.south)) clearAll();
    if (before && before !== world.origin) camera.anchor = world.toLocal(camera.anchor.map((c, axis) => c + before[axis]));
    vehicle.put(frame);
    const at = world.toLocal(place);
    look.heights = [at[2] - 2, at[2] + 10];
    camera.anchorAt(at);
  },
  processes: ({ json }) => showProcesses(json),
  counters: ({ json }) => showCounters(json, framesPerS),
};

// Another zone: coordinates mean another place.
function clearAll() {
  for (const part of [voxels, grid, scans, objects, vehicle]) part.clear();
}

function onConnection(now) {
  state.connection = now;
  showConnection(now);
  if (now.state === "starting") state.snapshot = null;
}

function draw() {
  resize();
  const view = camera.view(canvas.clientWidth, canvas.clientHeight);
  state.view = view;
  gl.clearColor(0.914, 0.933, 0.941, 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.enable(gl.DEPTH_TEST);
  gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  if (layers.voxels) voxels.draw(view, world, look);
  if (layers.ground || look.overlay !== "none") grid.draw(view, world, look.overlay);
  if (layers.vehicle) vehicle.draw(view, world, scans);
  if (layers.scan) scans.draw(view, world, false);
  gl.enable(gl.BLEND);
  gl.depthMask(false);
  objects.draw(view, world, layers);
  if (layers.fan) scans.draw(view, world, true);
  gl.depthMask(true);
  gl.disable(gl.BLEND);
  objects.drawLabels(view, world, layers.objects);
  $("compass").style.transform = `rotate(${-camera.azimuth}rad)`;
  state.drawnSnapshot = state.snapshot;
  state.frames++;
  framesShown++;
}

function resize() {
  const ratio = Math.min(2, devicePixelRatio || 1);
  const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  gl.viewport(0, 0, width, height);
}

function choose(id) {
  if (objects.chosen === id) return;
  objects.chosen = id;
  requestDraw();
}

function hover(x, y) {
  if (!state.view || x < 0) return choose(null), showTip(null);
  const object = layers.objects ? objects.pick(state.view, world, x, y) : null;
  choose(object?.id ?? null);
  if (object) return showTip(objectTip(object), x, y);
  const place = look.overlay === "none" ? null : pickGround(state.view.eye, rayThrough(state.view, x, y), world, grid);
  showTip(place && cellTip(place.cell, place.at), x, y);
}

// --- switches

function setLayer(name, on) {
  layers[name] = on;
  document.querySelector(`#layers input[name=${name}]`).checked = on;
  subscribe();
  requestDraw();
}

// Switched-off layers are not sent; a hidden page gets the lamps alone.
function subscribe() {
  const wanted = new Set(["processes", "counters"]);
  if (!document.hidden) {
    // The grid also colours the voxels, and the camera follows the vehicle.
    for (const name of ["grid", "vehicle"]) wanted.add(name);
    for (const [name, [, stream]] of Object.entries(LAYERS)) if (layers[name]) wanted.add(stream);
  }
  connection.subscribe([...wanted]);
}

function setLook(change) {
  Object.assign(look, change);
  $("voxel-colours").value = look.byHeight ? "height" : "class";
  $("overlay").value = look.overlay;
  $("legend").replaceChildren(...legend(look));
  requestDraw();
}

function setFollow(on) {
  camera.setFollow(on);
  $("follow").setAttribute("aria-pressed", on);
}

function reset() {
  camera.reset();
  $("follow").setAttribute("aria-pressed", true);
}

function toggleKeys() {
  $("keys").hidden = !$("keys").hidden;
  $("help").setAttribute("aria-pressed", !$("keys").hidden);
}

const OVERLAY_ORDER = ["none", "cost", "vegetation", "density", "evidence", "class"];
const KEYS = {
  f: () => setFollow(!camera.follow), r: reset, t: () => camera.fromAbove(), h: toggleKeys,
  c: () => setLook({ byHeight: !look.byHeight }),
  g: () => setLook({ overlay: OVERLAY_ORDER[(OVERLAY_ORDER.indexOf(look.overlay) + 1) % OVERLAY_ORDER.length] }),
};
Object.keys(LAYERS).forEach((name, i) => (KEYS[String(i + 1)] = () => setLayer(name, !layers[name])));

$("layers").append(...Object.entries(LAYERS).map(([name, [title, , colour]], i) => {
  const label = document.createElement("label"), box = document.createElement("input");
  Object.assign(box, { type: "checkbox", name, checked: true });
  box.onchange = () => setLayer(name, box.checked);
  label.title = `key ${i + 1}`;
  label.append(box, title, ...(colour ? [swatch(colour)] : []));
  return label;
}));
$("voxel-colours").onchange = (event) => setLook({ byHeight: event.target.value === "height" });
$("overlay").onchange = (event) => setLook({ overlay: event.target.value });
$("cut").oninput = (event) => {
  const cut = Number(event.target.value);
  $("cut-value").textContent = cut >= CUT_NONE_M ? "none" : `${cut.toFixed(2)} m`;
  setLook({ cutM: cut >= CUT_NONE_M ? Infinity : cut });
};
$("follow").onclick = KEYS.f;
$("reset").onclick = reset;
$("top").onclick = KEYS.t;
$("help").onclick = toggleKeys;
attachGestures(canvas, camera, { hover, key: (name) => (KEYS[name] ? (KEYS[name](), true) : false) });
addEventListener("resize", requestDraw);
document.addEventListener("visibilitychange", subscribe);
setInterval(() => {
  framesPerS = framesShown / 2;
  framesShown = 0;
  if (state.connection?.state === "failed") showConnection(state.connection);
}, 2000);
setLook({});
installHook({ gl, canvas, state, voxels, grid, scans, objects, camera, layers, draw, setLook, setLayer });
