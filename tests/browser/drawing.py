"""Drawing the scene's pixels for screenshots only, and fewer frames of what lives in the page.

Without a graphics card pixels are half of all that a browser test computes, and only pictures show them.
The scene itself lives on: its nodes, camera and pointer are the page's as ever. Its shaders are made when
it is first drawn.
"""

DRAW_ON_DEMAND = """
  const nextFrame = window.requestAnimationFrame.bind(window), due = new Map();
  let last = 0, waits = false;
  window.requestAnimationFrame = (callback) => {
    due.set(++last, callback);
    if (!waits) {
      waits = true;
      setTimeout(() => nextFrame(run), 40);
    }
    return last;
  };
  window.cancelAnimationFrame = (number) => { due.delete(number); };

  function run(time) {
    const callbacks = [...due.values()];
    due.clear();
    waits = false;
    drawOnDemand();
    for (const callback of callbacks) {
      try {
        callback(time);
      } catch (error) {
        reportError(error);
      }
    }
  }

  function drawOnDemand() {
    const renderer = window.__viserMutable?.scene?.__r3f?.root.getState().gl;
    if (!renderer || renderer.armctlDraws) return;
    const draw = renderer.armctlDraws = renderer.render;
    renderer.render = function (scene, camera) {
      if (window.armctlDraws) return draw.call(this, scene, camera);
      scene.updateMatrixWorld();  // for what the pointer hits
      camera.updateMatrixWorld();
    };
  }
"""
"""for a page that has not loaded yet: only ``DRAW_ONCE`` draws from now on, at most 25 frames a second"""

DRAW_ONCE = """async () => {
  const frame = () => new Promise(requestAnimationFrame);
  window.__viserMutable?.requestRender();
  await frame();  // what has come up to now is in the scene
  window.armctlDraws = true;
  await frame();
  window.armctlDraws = false;
  await frame();  // what was drawn is on the screen
}"""
