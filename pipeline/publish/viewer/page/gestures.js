// Pointer, wheel and keys over the image: turn, move the lamp, zoom, touch a place.

const DEGREES_A_WIDTH = 180;
const STEP_DEG = 5;
// A pointer that moved less than this, in CSS pixels, was a click.
const STILL = 5;

// `actions`: turn(across, up) and lamp(across, up) in degrees, zoom(factor), rest(), act(x, y) with
// coordinates 0 to 1 from the top left. A page with things to move has grab(x, y), which says whether something
// is there; then what follows is pull(x, y) and drop() in place of turns.
export function gestures(surface, actions) {
  const pointers = new Map();
  let moved = 0;
  let lamp = false;
  let carried = null; // whether the pointer that moves has grabbed something
  let spread = 0;
  let began = [0, 0];

  const place = (event) => {
    const box = surface.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  };
  const between = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };

  surface.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "mouse" && event.button === 1) return;
    surface.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (pointers.size === 1) [moved, lamp] = [0, event.shiftKey || event.button === 2];
    began = place(event);
    if (pointers.size === 2) [moved, spread] = [STILL, between()];
  });
  surface.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (pointers.size === 2) {
      const now = between();
      actions.zoom(spread / Math.max(now, 1));
      spread = now;
      return;
    }
    moved += Math.hypot(dx, dy);
    if (moved < STILL) return;
    carried ??= actions.grab?.(...began) ?? false;
    if (carried) {
      actions.pull(...place(event));
      return;
    }
    const scale = DEGREES_A_WIDTH / surface.getBoundingClientRect().width;
    if (lamp) actions.lamp(dx * scale, -dy * scale);
    else actions.turn(-dx * scale, dy * scale);
  });
  const ended = (event) => {
    if (!pointers.delete(event.pointerId) || pointers.size) return;
    if (carried) actions.drop();
    carried = null;
    if (moved < STILL && event.type === "pointerup" && !lamp) actions.act(...place(event), event.timeStamp);
    else actions.rest();
  };
  surface.addEventListener("pointerup", ended);
  surface.addEventListener("pointercancel", ended);
  surface.addEventListener("contextmenu", (event) => event.preventDefault());

  let resting = 0;
  const restSoon = () => {
    clearTimeout(resting);
    resting = setTimeout(actions.rest, 150);
  };
  surface.addEventListener(
    "wheel",
    (event) => {
      // A page is scrolled past a player; a player in use is zoomed.
      if (document.activeElement !== surface && !event.ctrlKey) return;
      event.preventDefault();
      actions.zoom(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 100) * 0.0012));
      restSoon();
    },
    { passive: false },
  );
  surface.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (arrow && event.shiftKey) actions.lamp(arrow[0] * STEP_DEG, arrow[1] * STEP_DEG);
    else if (arrow) actions.turn(arrow[0] * STEP_DEG, arrow[1] * STEP_DEG);
    else if (event.key === "+" || event.key === "=") actions.zoom(1 / 1.08);
    else if (event.key === "-") actions.zoom(1.08);
    else if (event.key === "Enter" || event.key === " ") actions.act(0.5, 0.5, event.timeStamp);
    else return;
    event.preventDefault();
    if (event.key !== "Enter" && event.key !== " ") restSoon();
  });
}
