// Where a ray meets the grid's ground: steps of a third of a metre, then halving.

const STEP_M = 0.33, REACH_M = 120;

export function pickGround(eye, ray, world, grid) {
  let before = 0;
  for (let range = 1; range < REACH_M; range += STEP_M) {
    const hit = below(eye, ray, range, world, grid);
    if (hit) return refine(before, range);
    before = range;
  }
  return null;

  function refine(low, high) {
    for (let i = 0; i < 6; i++) {
      const middle = (low + high) / 2;
      if (below(eye, ray, middle, world, grid)) high = middle;
      else low = middle;
    }
    return below(eye, ray, high, world, grid);
  }
}

// The cell under the ray's point, where that point lies below its ground.
function below(eye, ray, range, world, grid) {
  if (!world.origin) return null;
  const at = [0, 1, 2].map((axis) => world.origin[axis] + eye[axis] + range * ray[axis]);
  const cell = grid.cellAt(at[0], at[1]);
  return cell && cell.ground !== null && at[2] <= cell.ground + 0.1 ? { at, cell } : null;
}
