// What the colours mean. Swatches are small SVG drawings: the page's policy allows no inline styles.

import * as colours from "./colours.js";
import { VEGETATION_MAX_M } from "./grid.js";

const SVG = "http://www.w3.org/2000/svg";

function svg(name, attributes, ...children) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

function element(name, className, ...children) {
  const made = document.createElement(name);
  made.className = className;
  made.append(...children);
  return made;
}

export function swatch(colour, hatched = false) {
  const parts = [svg("rect", { width: 12, height: 12, fill: colour })];
  if (hatched) parts.push(svg("path", { d: "M-2 6 6-2M-2 14 14-2M6 14 14 6", stroke: "#fff", "stroke-width": 2.4 }));
  return svg("svg", { width: 12, height: 12, viewBox: "0 0 12 12" }, ...parts);
}

const key = (colour, text, hatched) => element("span", "key", swatch(colour, hatched), text);

function ramp(stops, low, high) {
  const id = `ramp-${stops[0].slice(1)}`;
  const gradient = svg("linearGradient", { id },
    ...stops.map((colour, i) => svg("stop", { offset: i / (stops.length - 1), "stop-color": colour })));
  const bar = svg("svg", { width: "100%", height: 9, preserveAspectRatio: "none" }, gradient,
    svg("rect", { width: "100%", height: 9, rx: 3, fill: `url(#${id})` }));
  return [element("div", "ramp", bar), element("div", "ends", element("span", "", low), element("span", "", high))];
}

const keys = (...list) => element("div", "keys", ...list);
const unknown = () => key(colours.UNKNOWN, "unknown", true);

export function legend(look) {
  const c = colours.CLASS_COLOURS;
  const voxels = look.byHeight
    ? ramp(colours.HEIGHT_RAMP, "2 m below", "10 m above the vehicle")
    : [keys(key(c.ground, "ground"), key(c.brush, "brush"), key(c.tree, "trunk"), key(c.obstacle, "obstacle"),
      key(c.drop, "drop"), key(c.canopy, "above"), key(c.unseen, "not classified"))];
  const overlay = {
    none: () => [],
    cost: () => [...ramp(colours.COST_RAMP, "free", "costly"), keys(key(colours.LETHAL, "never"), unknown())],
    vegetation: () => [...ramp(colours.VEGETATION_RAMP, "none", `${VEGETATION_MAX_M} m and more`), keys(unknown())],
    density: () => [...ramp(colours.VEGETATION_RAMP, "none", "100 % of the voxels"), keys(unknown())],
    evidence: () => [keys(key(colours.EVIDENCE_COLOURS[1], "measured"), key(colours.EVIDENCE_COLOURS[2], "interpolated"),
      key(colours.EVIDENCE_COLOURS[3], "extrapolated"), key(colours.EVIDENCE_COLOURS[4], "vehicle plane"), unknown())],
    class: () => [keys(unknown())],
  }[look.overlay]();
  return [...voxels, ...overlay];
}
