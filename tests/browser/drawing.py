"""Drawing the scene's pixels for screenshots only.

Without a graphics card they are half of all that a browser test computes, and only pictures show them.
The scene itself lives on: its nodes, shaders, camera and pointer are the page's as ever.
"""

DRAW_ON_DEMAND = """
  const graphics = WebGL2RenderingContext.prototype;
  const calls = ["clear", "drawArrays", "drawArraysInstanced", "drawElements", "drawElementsInstanced"];
  for (const call of calls) {
    const draw = graphics[call];
    graphics[call] = function (...what) {
      if (window.armctlDraws) draw.apply(this, what);
    };
  }
"""
"""for a page that has not loaded yet: from now on only ``DRAW_ONCE`` draws"""

DRAW_ONCE = """async () => {
  const frame = () => new Promise(requestAnimationFrame);
  window.armctlDraws = true;
  window.__viserMutable?.requestRender();
  await frame();
  await frame();
  window.armctlDraws = false;
  await frame();  // what was drawn is on the screen
}"""
