// All that armctl's scripts hold of the page of viser 1.1.1: its elements, its classes, its keys and its
// globals. `CONTRACT` in tests/ui/test_viser_seam.py lists what of it viser's client must have.
const armctlViser = (() => {
  "use strict";
  const STORED = "viser-user:"; // what viser puts before the server's keys in localStorage
  const SECTION = ".mantine-Paper-root"; // a folder of controls, and its head

  // viser reads this page's localStorage when the server asks for a key. `answers` by key: each gets what is
  // kept there, null for nothing, and gives what the server is told.
  function answer(answers) {
    const getItem = Storage.prototype.getItem;
    Storage.prototype.getItem = function (key) {
      const kept = getItem.call(this, key);
      const name = String(key);
      const own = name.startsWith(STORED) ? answers[name.slice(STORED.length)] : undefined;
      return own ? own(kept) : kept;
    };
  }

  // viser's line is opened by a worker, which is told where: the server hears of it who opens it.
  function nameLine(said) {
    const post = Worker.prototype.postMessage;
    Worker.prototype.postMessage = function (message, ...more) {
      const opens = message?.type === "set_server";
      const server = opens && `${message.server}/?${new URLSearchParams(said)}`;
      return post.call(this, opens ? { ...message, server } : message, ...more);
    };
  }

  // The labels of the tabs that are open: viser does not tell the server.
  function openTabs() {
    const tabs = document.querySelectorAll("#root [role=tab][aria-selected=true]");
    return Array.from(tabs, tabLabel);
  }
  // … and those of them that can be seen: those within a tab that is left stay in the document.
  function tabsInView() {
    const tabs = document.querySelectorAll("#root [role=tab][aria-selected=true]");
    return Array.from(tabs).filter((tab) => tab.offsetParent).map(tabLabel);
  }
  // On a phone the tabs stand below the program, which may be long: one that is opened comes into view.
  document.addEventListener("click", ({ target }) => {
    const tabs = target.closest?.("#root [role=tab]")?.closest("[role=tablist]");
    if (!tabs || !matchMedia("(max-width: 36em)").matches) return;
    const [sheet, at] = [tabs.closest(".mantine-ScrollArea-viewport"), tabs.getBoundingClientRect()];
    const seen = sheet?.getBoundingClientRect();
    if (!seen || at.top <= seen.top + seen.height / 3) return;
    let all = tabs.closest(".mantine-Tabs-root"); // the outermost: of the tabs, not of those within one
    for (let one = all; one; one = one.parentElement.closest(".mantine-Tabs-root")) all = one;
    all.style.minHeight = `${seen.height}px`; // a short one fills the sheet
    all.scrollIntoView({ block: "start" });
  });
  // … and so does what was asked for by a button, from that button on: what lies below may be a screen lower.
  let looked = null;
  function look() {
    const mark = document.querySelector("#root [data-armctl-look]");
    const newest = mark?.dataset.armctlLook ?? "";
    const anew = looked !== null && newest !== "" && looked !== newest;
    looked = newest;
    if (!anew || !matchMedia("(max-width: 36em)").matches) return;
    const form = mark.closest("form");
    for (const later of [50, 500, 1200]) setTimeout(() => form.scrollIntoView({ block: "start" }), later); // as it grows
  }
  const tabLabel = (tab) => (tab?.title || tab?.textContent || "").trim();

  // What a field means that is empty: viser's have no words for that.
  const EMPTY = { "Duration s": "auto", "Tool speed mm/s": "auto", "For s": "auto" };
  // viser's labels name few of its fields, for those who have them read aloud.
  function nameFields() {
    for (const label of document.querySelectorAll("#root p > label[for]")) {
      const name = label.textContent;
      const fields = label.parentElement.parentElement.nextElementSibling;
      if (!fields || label.dataset.armctlNamed === name) continue;
      const inputs = Array.from(fields.querySelectorAll("input:not([type=hidden]), textarea"));
      inputs.forEach((input, i) => {
        const axis = inputs.length > 1 && !fields.querySelector("[role=slider]") ? ` ${"xyz"[i]}` : "";
        if (input.labels.length === 0) input.setAttribute("aria-label", name + axis);
        if (name in EMPTY) input.placeholder = EMPTY[name];
      });
      fields.querySelector("[role=slider]")?.setAttribute("aria-label", name);
      if (fields.querySelector("button") && !inputs.length) {
        fields.setAttribute("role", "group");
        fields.setAttribute("aria-label", name);
      }
      label.dataset.armctlNamed = name;
    }
  }

  // viser's folders open by a click alone: they become buttons, which Enter and the space bar press.
  function nameSections() {
    for (const icon of document.querySelectorAll("svg.tabler-icon-chevron-up, svg.tabler-icon-chevron-down")) {
      const head = icon.parentElement;
      if (!head?.matches(SECTION)) continue;
      const open = String(icon.classList.contains("tabler-icon-chevron-up"));
      if (head.getAttribute("aria-expanded") === open) continue;
      head.setAttribute("role", "button");
      head.setAttribute("tabindex", "0");
      head.setAttribute("aria-label", `${head.textContent}, section`);
      head.setAttribute("aria-expanded", open);
    }
  }
  addEventListener("keydown", (event) => {
    const head = event.target instanceof Element && event.target.matches(`${SECTION}[aria-expanded]`);
    if (!head || (event.key !== "Enter" && event.key !== " ")) return;
    event.preventDefault();
    event.target.click();
  });

  // viser's buttons without words.
  const ICONS = {
    ".mantine-Notification-closeButton": "Close this message",
    "button:has(> * svg.tabler-icon-list-search)": "Commands (Ctrl+K)",
    "button:has(> * svg.tabler-icon-adjustments)": "Settings of the view",
  };
  function nameIcons() {
    document.getElementById("root").setAttribute("role", "main");
    for (const [selector, name] of Object.entries(ICONS))
      for (const button of document.querySelectorAll(`${selector}:not([aria-label])`)) button.setAttribute("aria-label", name);
  }

  // A notification gets a place for our own part, which is named after it; it is empty where there is none.
  function furnishNotifications() {
    for (const box of document.querySelectorAll(".mantine-Notification-root[id]:not(:has(armctl-part))")) {
      const part = document.createElement("armctl-part");
      part.setAttribute("name", `notification ${box.id}`);
      box.querySelector(".mantine-Notification-body")?.append(part);
    }
  }

  // The limits of sliders as numbers are written elsewhere: a digit behind the point, and a true minus.
  function writeLimits() {
    for (const { firstChild: text } of document.querySelectorAll(".mantine-Slider-markLabel")) {
      if (!/^-?\d+(\.\d+)?$/.test(text?.nodeValue)) continue;
      const short = String(Math.round(10 * text.nodeValue) / 10).replace("-", "\u2212");
      if (text.nodeValue !== short) text.nodeValue = short;
    }
  }

  // Everything that has no name yet.
  function name() {
    nameControls();
    writeLimits();
    nameIcons();
    look();
  }
  function nameControls() {
    nameFields();
    nameSections();
  }
  // Fields that have just come have theirs before they are drawn: some styles lay them out by it.
  function nameAtOnce() {
    const labelled = (node) => node instanceof Element && node.querySelector("p > label[for]");
    const came = new MutationObserver((changes) => {
      const viser = changes.filter(({ target }) => !target.closest("armctl-part"));
      if (viser.some(({ addedNodes }) => Array.from(addedNodes).some(labelled))) nameControls();
    });
    came.observe(document.getElementById("root"), { childList: true, subtree: true });
  }

  // Fill a field of viser's as typing there would: React hears no other event.
  function type(input, text) {
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(input, text);
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }

  // What has been typed into viser's fields, and still stands there: the open tabs around each, its label, and which
  // of those of this label in view it was. Those that `secret(label)` are left out; so is what is ticked, as that may
  // let something begin.
  const typed = new Map();
  const FIELDS = "#root :is(input, textarea):not([type=password], [type=range], [type=checkbox], [readonly])";
  addEventListener("input", ({ isTrusted, target }) => isTrusted && target.matches(FIELDS) && note(target), true);
  const labelOf = (field) => field.getAttribute("aria-label") ?? field.labels[0]?.textContent ?? "";
  function tabsAround(field) {
    const around = [];
    for (let at = field.closest("[data-dock-group]"); at; at = at.parentElement.closest("[data-dock-group]"))
      around.unshift(tabLabel(at.querySelector("[role=tab][aria-selected=true]")));
    return around.join(" / ");
  }
  function inView(tabs, label) {
    const fields = Array.from(document.querySelectorAll(FIELDS));
    return fields.filter((one) => one.offsetParent && labelOf(one) === label && tabsAround(one) === tabs);
  }
  function note(field) {
    const [tabs, label] = [tabsAround(field), labelOf(field)];
    typed.set(field, { tabs, label, nth: inView(tabs, label).indexOf(field), value: field.value });
  }
  function typedFields(secret) {
    const all = Array.from(typed).filter(([field, { label, value }]) => field.isConnected && field.value === value && !secret(label));
    return all.map(([, kept]) => kept);
  }

  // Type the next one of them again; gives those that are left, which may not be in view yet. One at a time: of what
  // is typed within 50 ms, viser tells its server the first and the last alone.
  function typeAgain(all) {
    let once = false;
    return all.filter(({ tabs, label, nth, value }) => {
      const field = !once && inView(tabs, label)[nth];
      if (!field || field.disabled) return true;
      if (typed.has(field)) return false; // somebody was faster
      type(field, value);
      note(field);
      once = true;
      return false;
    });
  }

  // Open the tabs of these labels, one after the other, as one may be in another; gives those that are left.
  function openAgain(labels) {
    const tabs = Array.from(document.querySelectorAll("#root [role=tab]"));
    const tab = tabs.find((one) => tabLabel(one) === labels[0]);
    if (tab) press(tab);
    return tab ? labels.slice(1) : labels;
  }
  function press(tab) {
    const enter = { key: "Enter", bubbles: true }; // a click without a pointer does nothing there
    if (tab.getAttribute("aria-selected") === "false") tab.dispatchEvent(new KeyboardEvent("keydown", enter));
  }

  // Tabs that the server has built anew begin at the first. The one that was open among the same labels is opened, also
  // where the arm is another one: once armctl's own line is `back` as well. Numbered steps begin at the first anyway.
  const openIn = new Map();
  function keepTabs(back) {
    for (const list of document.querySelectorAll("#root [role=tablist]")) {
      const tabs = Array.from(list.querySelectorAll("[role=tab]"));
      const key = tabs.map(tabLabel).join("\n");
      const [had, open] = [openIn.get(key), tabs.find((one) => one.getAttribute("aria-selected") === "true")];
      const anew = had && !had.list.isConnected;
      if (anew && !(had.seen && back)) {
        had.seen = true; // at the next look that line knows, too, that it has ended
        continue;
      }
      const again = anew && !/^\d/.test(key) && tabs.find((one) => tabLabel(one) === had.label);
      if (again) press(again);
      openIn.set(key, { list, label: tabLabel(again || open), seen: false });
    }
  }

  // A dropdown keeps the focus after a choice by mouse; keys that do something would go on to be typed into it.
  function letGoOfLists() {
    addEventListener("click", (event) => {
      if (event.detail && event.target.closest?.("[role=option]:not(armctl-part *)")) setTimeout(() => document.activeElement.blur());
    }, true);
  }

  // viser's page hears its server from the loop that draws the scene: where a browser has no WebGL, three.js draws
  // with this, which answers as a context does, and draws nothing.
  function drawNothing() {
    const asked = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
      return asked.call(this, kind, ...more) ?? (kind === "webgl2" || kind === "webgl" ? nothing(this) : null);
    };
  }
  function nothing(canvas) {
    // A browser without even the names of WebGL's numbers: each name stands for itself.
    const number = (name) => globalThis.WebGL2RenderingContext?.[name] ?? name;
    const none = new Set(["ACTIVE_UNIFORMS", "ACTIVE_ATTRIBUTES", "ACTIVE_UNIFORM_BLOCKS"].map(number));
    const parameters = new Map(
      Object.entries({
        VERSION: "WebGL 2.0",
        SHADING_LANGUAGE_VERSION: "WebGL GLSL ES 3.00",
        SCISSOR_BOX: [0, 0, 1, 1],
        VIEWPORT: [0, 0, 1, 1],
        IMPLEMENTATION_COLOR_READ_FORMAT: number("RGBA"),
        IMPLEMENTATION_COLOR_READ_TYPE: number("UNSIGNED_BYTE"),
      }).map(([name, value]) => [number(name), value]),
    );
    const answers = {
      canvas,
      getContextAttributes: () => ({ alpha: true, antialias: false, depth: true, stencil: false }),
      getSupportedExtensions: () => [],
      getShaderPrecisionFormat: () => ({ rangeMin: 127, rangeMax: 127, precision: 23 }),
      getProgramParameter: (_, name) => (none.has(name) ? 0 : true),
      checkFramebufferStatus: () => number("FRAMEBUFFER_COMPLETE"),
      clientWaitSync: () => number("ALREADY_SIGNALED"),
      getParameter: (name) => (parameters.has(name) ? parameters.get(name) : 4096),
    };
    const simple = { create: {}, fence: {}, is: false, getError: 0, getExtension: null, getAttribLocation: -1 };
    return new Proxy(answers, {
      get: (_, name) => {
        if (name in answers) return answers[name];
        if (name === "drawingBufferWidth") return canvas.width;
        if (name === "drawingBufferHeight") return canvas.height;
        if (typeof name !== "string") return undefined;
        if (/^[A-Z]/.test(name)) return number(name);
        const kind = Object.keys(simple).find((start) => name.startsWith(start));
        if (kind) return () => simple[kind];
        if (/InfoLog$|Source$/.test(name)) return () => "";
        return /^get.*Parameter$/.test(name) ? () => true : () => undefined;
      },
    });
  }

  // The labels in the scene are black on white: viser's shaders say so. In the dark theme they are light on dark.
  const LABELS = [
    ["vec4(0.0, 0.0, 0.0, a)", "vec4(vec3(0.92 * armctlDark), a)"],
    ["vec4(1.0, 1.0, 1.0, 0.85 * vAlpha)", "vec4(vec3(1.0 - 0.86 * armctlDark), 0.85 * vAlpha)"],
  ];
  function darkenLabels() {
    const context = globalThis.WebGL2RenderingContext?.prototype;
    if (!context) return;
    const { shaderSource, attachShader, useProgram } = context;
    const [ours, places] = [new WeakSet(), new WeakMap()];
    context.shaderSource = function (shader, source) {
      const label = LABELS.find(([was]) => source.includes(was));
      if (label) {
        ours.add(shader);
        source = source.replace(...label).replace("void main() {", "uniform float armctlDark;\nvoid main() {");
      }
      shaderSource.call(this, shader, source);
    };
    context.attachShader = function (program, shader) {
      attachShader.call(this, program, shader);
      if (ours.has(shader)) places.set(program, null);
    };
    context.useProgram = function (program) {
      useProgram.call(this, program);
      if (!program || !places.has(program)) return;
      const place = places.get(program) ?? this.getUniformLocation(program, "armctlDark");
      places.set(program, place);
      this.uniform1f(place, document.documentElement.dataset.mantineColorScheme === "dark" ? 1 : 0);
    };
  }

  // What of the window the picture of the scene takes: its edges are told whenever they have changed [px].
  function onSceneEdges(tell) {
    const sizes = new ResizeObserver(() => {
      const box = document.querySelector("[data-dock-root] > div")?.getBoundingClientRect();
      if (box) tell(box.left, innerWidth - box.right);
    });
    sizes.observe(document.documentElement);
    const found = new MutationObserver(() => {
      const scene = document.querySelector("[data-dock-root] > div");
      if (!scene) return;
      sizes.observe(scene);
      found.disconnect();
    });
    found.observe(document.getElementById("root"), { childList: true, subtree: true });
  }

  // The scene is clicked, or pressed with the right button or by a finger that stays, and not dragged: a ray from the
  // camera in the scene's own frame, and where in the window: `pressed(long, [x, y, z, dx, dy, dz], left, top)`.
  // The pointer shows that nodes whose names begin with `pressable` take a click.
  const [STILL_PX, LONG_MS] = [6, 550];
  function onScenePress(pressed, pressable) {
    let began = null;
    const isScene = (element) => element instanceof HTMLCanvasElement && element.closest("[data-dock-root]");
    const moved = (event) => Math.hypot(event.clientX - began.x, event.clientY - began.y) > STILL_PX;
    const end = () => {
      clearTimeout(began?.timer);
      began = null;
    };
    const tell = (long) => {
      const ray = rayAt(began.canvas, began.x, began.y);
      if (ray) pressed(long, ray, began.x, began.y);
    };
    addEventListener("pointerdown", (event) => {
      const second = began !== null;
      end();
      if (second || !isScene(event.target) || event.button === 1) return;
      began = { x: event.clientX, y: event.clientY, canvas: event.target };
      if (event.pointerType !== "touch") return;
      began.timer = setTimeout(() => {
        tell(true);
        end();
      }, LONG_MS);
    }, true);
    let looks = false;
    addEventListener("pointermove", (event) => {
      if (began && moved(event)) end();
      const { target: canvas, clientX, clientY } = event;
      if (looks || event.pointerType !== "mouse" || !isScene(canvas)) return;
      looks = true;
      requestAnimationFrame(() => {
        looks = false;
        const over = !event.buttons && isMet(rayAt(canvas, clientX, clientY), pressable);
        canvas.toggleAttribute("data-armctl-pressable", over);
      });
    }, true);
    addEventListener("pointerup", (event) => {
      if (began) tell(event.button === 2);
      end();
    }, true);
    addEventListener("pointercancel", end, true);
    addEventListener("contextmenu", (event) => isScene(event.target) && event.preventDefault(), true);
  }
  function rayAt(canvas, x, y) {
    const viewer = window.__viserMutable;
    const [camera, root] = [viewer?.camera, viewer?.nodeRefFromName["/floor"]?.parent];
    if (!camera || !root) return null;
    const box = canvas.getBoundingClientRect();
    const at = [(2 * (x - box.left)) / box.width - 1, 1 - (2 * (y - box.top)) / box.height];
    const [near, far] = [-0.9, 0.9].map((depth) => root.worldToLocal(camera.position.clone().set(...at, depth).unproject(camera)));
    return [...near.toArray(), ...far.sub(near).normalize().toArray()];
  }

  function isMet(ray, start) {
    const viewer = window.__viserMutable;
    return ray !== null && Object.entries(viewer.nodeRefFromName).some(([name, node]) => {
      if (!node?.visible || !name.startsWith(start)) return false;
      const toward = node.position.toArray().map((one, k) => one - ray[k]); // from the eye to its middle
      const along = toward[0] * ray[3] + toward[1] * ray[4] + toward[2] * ray[5];
      const beside = Math.hypot(...toward.map((one, k) => one - along * ray[k + 3]));
      return along > 0 && beside <= radiusOf(node);
    });
  }
  function radiusOf(node) {
    let radius = 0;
    node.traverse(({ geometry, matrixWorld }) => {
      if (!geometry) return;
      geometry.boundingSphere ?? geometry.computeBoundingSphere(); // of a ball it is 1, its size is a scale
      radius = Math.max(radius, geometry.boundingSphere.radius * matrixWorld.getMaxScaleOnAxis());
    });
    return radius;
  }

  // The scene, once viser has built the node `root`; null before. Poses go where those of its server go.
  function scene(root) {
    const viewer = window.__viserMutable;
    if (!viewer?.nodeRefFromName[root]) return null;
    return {
      pose: (name, position, wxyz) =>
        viewer.messageQueue.push(
          { type: "SetPositionMessage", name, owner: "", position },
          { type: "SetOrientationMessage", name, owner: "", wxyz },
        ),
      show: (name, visible) =>
        viewer.messageQueue.push({ type: "SetSceneNodeVisibilityMessage", name, owner: "", visible }),
      draw: () => viewer.requestRender(),
    };
  }

  return {
    answer, nameLine, openTabs, tabsInView, openAgain, keepTabs, typedFields, typeAgain, name, nameAtOnce,
    furnishNotifications, letGoOfLists, drawNothing, darkenLabels, onSceneEdges, onScenePress, scene,
  };
})();
