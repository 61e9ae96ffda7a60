// Plays a planned motion in viser's client, which shows the scene of the same file (twin_file.py).
(async () => {
  "use strict";
  const element = (name) => document.getElementById(`twin-${name}`);
  const twin = JSON.parse(element("data").textContent);
  const { duration, frames } = twin;

  // Each column: the low bytes of the differences from frame to frame, then their high bytes.
  const packed = Uint8Array.from(atob(twin.columns), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const columns = twin.ranges.map(([low, step], column) => {
    const values = new Float64Array(frames);
    const at = 2 * column * frames;
    for (let word = 0, i = 0; i < frames; i++) {
      word = (word + bytes[at + i] + 256 * bytes[at + frames + i]) & 0xffff;
      values[i] = low + step * word;
    }
    return values;
  });

  function sample(column, time) {
    const at = duration ? (time / duration) * (frames - 1) : 0;
    const i = Math.min(Math.floor(at), frames - 1);
    const next = columns[column][Math.min(i + 1, frames - 1)];
    return columns[column][i] + (at - i) * (next - columns[column][i]);
  }

  const fixed = (value) => (Math.abs(value) < 0.05 ? 0 : value).toFixed(1).replace("-", "−");

  function pose(scene, time) {
    for (const [name, first] of twin.tracks) {
      const [x, y, z, ...turn] = [0, 1, 2, 3, 4, 5, 6].map((i) => sample(first + i, time));
      const length = Math.hypot(...turn);
      scene.pose(name, [x, y, z], turn.map((part) => part / length));
    }
    for (const nodes of [twin.tools, twin.parts]) {
      const shown = nodes.findLast(([begins]) => begins <= time + 1e-9)[1];
      for (const [, name] of nodes) if (name) scene.show(name, name === shown);
    }
    scene.draw();
  }

  const graphs = Array.from(document.querySelectorAll("#twin-side svg"));
  const values = Array.from(document.querySelectorAll("[data-column]"));
  let time = 0;
  let shown = null;
  let before = null;
  let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;

  function tell() {
    element("play").textContent = playing ? "Pause" : "Play";
    element("seek").value = time;
    element("time").textContent = `${time.toFixed(1)} / ${duration.toFixed(1)} s`;
    const step = twin.steps.findLast(([begins]) => begins <= time + 1e-9);
    element("step").textContent = step ? step[1] : "";
    for (const value of values) value.textContent = fixed(sample(+value.dataset.column, time));
    for (const graph of graphs) {
      const { left, width } = graph.dataset;
      const x = +left + (duration ? (+width * time) / duration : 0);
      graph.querySelector(".now").setAttribute("transform", `translate(${x} 0)`);
    }
  }

  function frame(now) {
    requestAnimationFrame(frame);
    const scene = armctlViser.scene(twin.root);
    if (!scene) return; // viser is still building it
    if (playing && before !== null) {
      time = Math.min(time + ((now - before) / 1000) * +element("speed").value, duration);
      playing = time < duration;
    }
    before = now;
    const state = `${time} ${playing}`;
    if (state === shown) return;
    shown = state;
    pose(scene, time);
    tell();
  }

  function go(to) {
    playing = false;
    time = Math.min(Math.max(to, 0), duration);
  }

  function toggle() {
    if (!playing && time >= duration) time = 0;
    playing = !playing;
  }

  element("play").addEventListener("click", toggle);
  element("seek").addEventListener("input", (event) => go(+event.target.value));
  addEventListener("keydown", (event) => {
    if (event.code !== "Space" || event.target.matches("button, select")) return;
    event.preventDefault();
    toggle();
  });
  for (const button of document.querySelectorAll("[data-time]")) {
    button.addEventListener("click", () => go(+button.dataset.time));
  }
  for (const graph of graphs) {
    const drag = (event) => {
      if (!event.buttons) return;
      const box = graph.getBoundingClientRect();
      const scale = graph.viewBox.baseVal.width / box.width;
      go((duration * ((event.clientX - box.left) * scale - graph.dataset.left)) / graph.dataset.width);
    };
    graph.addEventListener("pointerdown", (event) => {
      graph.setPointerCapture(event.pointerId);
      drag(event);
    });
    graph.addEventListener("pointermove", drag);
  }
  tell();
  requestAnimationFrame(frame);
})().catch((error) => {
  document.getElementById("twin-step").textContent = `This browser cannot play the file: ${error.message}`;
});
