// Colours, once for the shaders and once for the legend. Classes as in the thesis: ground green, brush dark green,
// trunks purple. Traversability runs from blue to red: two hues that also the colour-blind tell apart.

export const CLASS_COLOURS = {
  ground: "#8cbf63", brush: "#2f6a36", tree: "#7a3fb0", canopy: "#a7b394", obstacle: "#8d8078", drop: "#c2552d", unseen: "#b9beb4",
};
export const HEIGHT_RAMP = ["#31487e", "#2a788e", "#3fae7c", "#b8d63c", "#fbe04a"];
export const COST_RAMP = ["#3b7fc0", "#a8d3e6", "#fdf3b0", "#f79a4e", "#d7352b"];
export const LETHAL = "#5a0a12";
export const UNKNOWN = "#9aa09b";
export const VEGETATION_RAMP = ["#eef4d8", "#a9cf7b", "#4f9a4a", "#1d5c33", "#0b3320"];
export const EVIDENCE_COLOURS = ["#9aa09b", "#3f8f4f", "#a6cf7d", "#f0d37a", "#6fa3d8"];
export const SCAN = "#e8481c";
export const OBJECT = "#f0a020";
export const CANDIDATE = "#d0529a";

export const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
export const glsl = (hex) => `vec3(${rgb(hex).map((c) => c.toFixed(4)).join(", ")})`;

// A GLSL function of 0..1 through five colours.
export function glslRamp(name, ramp) {
  return `vec3 ${name}(float t) {
    vec3 c[5] = vec3[5](${ramp.map(glsl).join(", ")});
    float s = clamp(t, 0.0, 1.0) * 3.9999;
    int i = int(s);
    return mix(c[i], c[i + 1], s - float(i));
  }\n`;
}
