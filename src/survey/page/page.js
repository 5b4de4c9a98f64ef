const map = document.querySelector("#map"), label = map.querySelector("output");
const table = document.querySelector("#trees"), body = table.tBodies[0];
const rows = new Map([...body.rows].map((row) => [row.dataset.id, row]));
const circles = new Map([...map.querySelectorAll("circle")].map((circle) => [circle.dataset.id, circle]));
let shown = null;

// The tree under the pointer, on the map and in the table alike.
function show(id) {
  for (const set of [rows, circles]) {
    set.get(shown)?.classList.remove("on");
    set.get(id)?.classList.add("on");
  }
  shown = id;
}

function tell(circle) {
  const row = rows.get(circle.dataset.id);
  const cells = row ? [...row.cells].map((cell) => cell.textContent) : null;
  label.textContent = cells
    ? `tree ${cells[0]}\nDBH ${cells[1]} ± ${cells[2]} cm\nheight ${cells[3]} m\n${cells[4]} E  ${cells[5]} N`
    : `tree ${circle.dataset.id}`;
  label.hidden = false;
  const at = circle.getBoundingClientRect(), frame = map.getBoundingClientRect();
  const left = at.right - frame.left + 8, wide = label.offsetWidth;
  label.style.left = `${left + wide > frame.width ? Math.max(0, at.left - frame.left - wide - 8) : left}px`;
  label.style.top = `${Math.max(0, Math.min(at.top - frame.top - 8, frame.height - label.offsetHeight))}px`;
}

map.addEventListener("pointerover", (event) => {
  const circle = event.target.closest("circle");
  if (circle) { show(circle.dataset.id); tell(circle); } else { show(null); label.hidden = true; }
});
map.addEventListener("pointerleave", () => { show(null); label.hidden = true; });
body.addEventListener("pointerover", (event) => {
  const row = event.target.closest("tr");
  if (row) { show(row.dataset.id); }
});
body.addEventListener("pointerleave", () => show(null));

// A dash is no number: it comes last, whichever way the others go.
table.tHead.addEventListener("click", (event) => {
  const head = event.target.closest("th");
  if (!head) { return; }
  const down = head.getAttribute("aria-sort") === "ascending";
  for (const other of table.tHead.rows[0].cells) { other.removeAttribute("aria-sort"); }
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  const value = (row) => Number.parseFloat(row.cells[head.cellIndex].textContent);
  const order = (a, b) => {
    const [x, y] = [value(a), value(b)];
    if (Number.isNaN(x) || Number.isNaN(y)) { return Number.isNaN(x) - Number.isNaN(y); }
    return down ? y - x : x - y;
  };
  body.append(...[...body.rows].sort(order));
});
