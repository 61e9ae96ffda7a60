// What a gamepad, a 3D mouse or two thumbs on the glass push, told to the server while somebody holds on.
// A part that wants to hear has data-sticks, "held" while the arm is held back; its thumb pads have data-thumb.
// Six numbers, -1 to 1: forward, left, up, turn to the left, lift, lean to the left; then when [ms].
(() => {
  "use strict";
  const EVERY_MS = 50;
  const AT_REST = 0.12; // sticks never come back to 0 quite
  const [HOLD, STOP_BUTTONS] = [[4, 5], [8, 9, 16]]; // shoulder buttons; those in the middle (W3C Gamepad, "standard")
  const TOOLS = { 0: "close", 1: "open" };
  const NOTHING = [0, 0, 0, 0, 0, 0];
  const isDown = (pad, button) => Boolean(pad.buttons[button]?.pressed);
  const beyondRest = (value) => Math.sign(value) * Math.max(0, (Math.abs(value) - AT_REST) / (1 - AT_REST));

  // A gamepad has two sticks and a cross; a 3D mouse six axes and two buttons, the first of which is to be held. Of all
  // others nobody knows what is where: triggers rest at -1, a throttle anywhere.
  const MOUSE_3D = /3dconnexion|space ?(mouse|navigator|pilot|explorer)|\b256f\b/i;
  function readPad(pad) {
    const a = Array.from(pad.axes, beyondRest);
    if (pad.mapping === "standard") {
      const cross = (one, other) => Number(isDown(pad, one)) - Number(isDown(pad, other));
      const down = Object.keys(TOOLS).filter((button) => isDown(pad, button));
      const axes = [-a[1], -a[0], -a[3], -a[2], cross(12, 13), cross(14, 15)];
      return { axes, held: HOLD.some((one) => isDown(pad, one)), stop: STOP_BUTTONS.some((one) => isDown(pad, one)), down };
    }
    if (a.length !== 6 || !MOUSE_3D.test(pad.id)) return null;
    return { axes: [-a[1], -a[0], -a[2], -a[5], a[3], -a[4]], held: isDown(pad, 0), stop: isDown(pad, 1), down: [] };
  }

  // Two thumbs: the pad is held as long as a finger is on it.
  const fingers = new Map(); // by pointer: the pad, and where on it, -1 to 1
  function feel(event) {
    const { pad } = fingers.get(event.pointerId);
    const box = pad.getBoundingClientRect();
    const at = (value, low, size) => Math.max(-1, Math.min(1, (2 * (value - low)) / size - 1));
    const [x, y] = [at(event.clientX, box.left, box.width), at(event.clientY, box.top, box.height)];
    fingers.set(event.pointerId, { pad, x, y });
    for (const [name, value] of [["--x", x], ["--y", y]]) pad.style.setProperty(name, value);
  }
  addEventListener("pointerdown", (event) => {
    const pad = event.target instanceof Element && event.target.closest("[data-sticks] [data-thumb]");
    if (!pad || event.button !== 0) return;
    event.preventDefault(); // no selection of text, no menu
    pad.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { pad, x: 0, y: 0 });
    feel(event);
  });
  addEventListener("pointermove", (event) => fingers.has(event.pointerId) && feel(event));
  for (const what of ["pointerup", "pointercancel", "lostpointercapture"])
    addEventListener(what, ({ pointerId }) => {
      const pad = fingers.get(pointerId)?.pad;
      fingers.delete(pointerId);
      for (const name of ["--x", "--y"]) pad?.style.removeProperty(name);
    }, true);
  function readThumbs() {
    const axes = [...NOTHING];
    for (const { pad, x, y } of fingers.values()) {
      const [across, upwards] = pad.dataset.thumb.split(" ").map(Number);
      [axes[across], axes[upwards]] = [-x, -y].map(beyondRest);
    }
    return { axes, held: fingers.size > 0, stop: false, down: [] };
  }

  // Who switches it on while something is held has to let go first; so has who comes back to this page, or plugs
  // something in. What does not rest in its middle once is not heard.
  let [held, ready, stopped, down, name, rumbled, there] = [false, false, false, [], "", false, ""];
  const rested = new Set();
  const say = (what, value) => globalThis.armctlTell?.({ do: what, value });
  function tick() {
    const place = document.querySelector("armctl-part [data-sticks]");
    const visible = Boolean(place) && document.visibilityState === "visible";
    const here = visible && document.hasFocus();
    const pads = visible ? navigator.getGamepads().filter(Boolean) : [];
    const found = pads.map((pad) => [pad, readPad(pad), `${pad.index} ${pad.id}`]).filter(([, read]) => read);
    const keys = found.map(([, , key]) => key);
    for (const [, { axes }, key] of found) if (!axes.some(Boolean)) rested.add(key);
    for (const key of rested) if (!keys.includes(key)) rested.delete(key);
    const same = there === (there = keys.join());
    if (found.some(([, read]) => read.stop) !== stopped && (stopped = !stopped)) globalThis.armctlStop();
    const heard = found.filter(([, , key]) => rested.has(key));
    const [pad, read] = heard.find(([, one]) => one.held) ?? [found[0]?.[0], readThumbs()];
    const holds = here && read.held;
    ready = here && same && !stopped && (ready || !read.held);
    const seen = pad ? pad.id + (heard.some(([one]) => one === pad) ? "" : " (let its sticks go)") : "";
    if (place && name !== seen) say("sticks-seen", (name = seen));
    if (holds && ready) say("sticks", [...read.axes.map((one) => one.toFixed(2)), performance.now().toFixed(0)].join(" "));
    else if (held) say("sticks", stopped ? "stopped" : "let go");
    held = holds && ready;
    for (const one of held ? read.down : []) if (!down.includes(one)) say("sticks-jaw", TOOLS[one]);
    down = read.down;
    const feels = held && place.dataset.sticks === "held";
    if (feels && !rumbled) pad?.vibrationActuator?.playEffect?.("dual-rumble", { duration: 200, strongMagnitude: 0.5, weakMagnitude: 0.5 });
    rumbled = feels;
  }
  setInterval(tick, EVERY_MS);
})();
