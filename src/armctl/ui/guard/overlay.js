// What armctl lays over viser's page. STOP that is always there: the large button at the left end of the bar, Escape
// from every place of the page, and a line to the arm that waits for nothing else (stop_line.py). A banner on a page
// that watches. What it asks of viser's page is `armctlViser` (viser_seam.js).
(() => {
  "use strict";
  const BEAT_MS = 200;
  const RETRY_MS = 300;
  const PATIENCE_MS = 1000; // for an answer to STOP
  const OPENING_MS = 3000;
  const LOST_BEATS = 10; // without an echo, before the line counts as lost
  const LATEST_MS = 5000; // a STOP that is older is not sent again
  const ASK_BEATS = 5;
  const LEFT_MS = 5000; // after which a page that viser has lost is loaded anew
  const RELOAD_MS = 20000; // so long a server may take to serve it
  const KNOCK_MS = 3000;
  const SETTLED_MS = 300; // so long a window that is resized rests before it is told
  const AGAIN_MS = 10000; // so long what a page had may not be there again
  const STOP = "[data-armctl-stop]";
  const SECOND = "The line of STOP is lost. STOP goes over the page's own line: have the power switch at hand.";
  const LOST =
    "Not connected: STOP does not reach the arm. Use the power switch. What is shown here is old. " +
    "To go on, see that armctl runs: then this page comes back by itself.";
  const SHUT_OUT =
    "armctl runs again, with a new link: STOP does not reach the arm from here. Open the link that it printed.";
  const UNANSWERED = "STOP was not confirmed. Use the power switch.";
  const NO_3D =
    "This browser draws no 3D (WebGL), so the picture of the arm is missing. Everything else works. For the picture, " +
    "switch on hardware acceleration in the browser's settings, or open the link in another browser or on another computer.";
  const began = performance.now();
  const page = taken("armctl-page") ?? Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) =>
    byte.toString(16).padStart(2, "0"),
  ).join("");

  const load = crypto.getRandomValues(new Uint32Array(2)).join(".");
  Object.assign(globalThis, { armctlPage: page, armctlLoad: load }); // the line of its parts says them, too (parts.js)

  // This page's name outlives its being loaded anew, so that control comes back to it; so do its tabs and what is
  // typed. In between they are kept; while the page is open they are not, as a copy of its tab would get them, too.
  function taken(key) {
    try {
      const kept = sessionStorage.getItem(key);
      sessionStorage.removeItem(key);
      return kept;
    } catch {
      return null; // this browser keeps nothing
    }
  }
  const SECRET = /\bPIN\b/;
  let left = taken("armctl-left");
  let seen = { kept: [], tabs: [], fields: [] };
  // Nothing is noted of a page that is about to go: viser comes back to another server ahead of it, and begins anew.
  function look() {
    if (!same || performance.now() - reloaded < RELOAD_MS) return;
    const kept = Array.from(document.querySelectorAll("[data-keep]"), ({ dataset }) => [dataset.keep, dataset.kept]);
    seen = { ...seen, title: document.title, kept };
    const tabs = viser("tabsInView") ?? [];
    if (!tabs.length) return; // they are folded, or not there yet
    seen = { ...seen, tabs, fields: viser("typedFields", (label) => SECRET.test(label)) ?? [] };
  }
  addEventListener("pagehide", () => {
    look();
    const all = typeof left === "string" ? left : JSON.stringify({ ...seen, ...notYetBack() });
    try {
      sessionStorage.setItem("armctl-page", page);
      sessionStorage.setItem("armctl-left", all);
    } catch (error) {
      console.warn("this browser keeps nothing while a page is loaded anew", error);
    }
  });
  // A page may be loaded anew once more before it has all of it again.
  function notYetBack() {
    if (!left) return {};
    const again = performance.now() - began < AGAIN_MS ? left.kept : [];
    return {
      ...((left.toOpen.length || !seen.tabs.length) && !chosen && { tabs: left.tabs }),
      title: seen.title ?? left.title,
      fields: seen.fields.concat(left.fields ?? []),
      kept: seen.kept.length ? seen.kept : again,
    };
  }
  function giveBack() {
    if (!left || document.title === "armctl") return; // the bar has not come, which names the arm
    const had = left;
    left = null; // where it cannot be read, too
    const all = typeof had === "string" ? JSON.parse(had) : had;
    const { title, kept, tabs, toOpen = tabs, told } = all;
    if (document.title !== title) return;
    if (!told) for (const [what, value] of kept) globalThis.armctlTell({ do: what, value });
    const [later, fields] = [viser("openAgain", chosen ? [] : toOpen) ?? [], viser("typeAgain", all.fields) ?? []];
    left = { title, kept, tabs, toOpen: later, fields, told: true };
  }
  // Who is here already, and does something, goes on from there.
  let chosen = false;
  const choose = ({ isTrusted }) => (chosen ||= isTrusted);
  for (const what of ["pointerdown", "keydown"]) addEventListener(what, choose, true);

  // STOP and its line stand whatever of viser's page is not as it was: what cannot be asked of it is told once.
  const failed = new Set();
  function viser(what, ...given) {
    try {
      return armctlViser[what](...given);
    } catch (error) {
      if (!failed.has(what)) console.error(`viser's page: ${what}`, error);
      failed.add(what);
      return null;
    }
  }

  // The parts of this page can come before viser has built its own. The server asks for these, too: so it learns that
  // the page answers, and which line is whose. The theme is the one chosen here, or else the system's.
  viser("nameLine", { page, load });
  viser("answer", {
    "armctl-page": () => `${page} ${load}`,
    "armctl-drawn-by": drawnBy,
    "armctl-window": () => `${innerWidth} ${innerHeight}`,
    "armctl-theme": (kept) => kept ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "Dark" : null),
  });

  // Short: a message on the line has 256 bytes.
  function openTabs() {
    return (viser("openTabs") ?? []).slice(0, 3).map((label) => label.slice(0, 16));
  }

  // Shadows are for a graphics card: they take two thirds of the pictures a second without one.
  const draws = document.createElement("canvas").getContext("webgl2") !== null;
  viser("darkenLabels");
  if (!draws) viser("drawNothing"); // else the page would hear nothing of its server
  function drawnBy() {
    const gl = document.createElement("canvas").getContext("webgl2");
    const told = gl?.getExtension("WEBGL_debug_renderer_info");
    const name = told ? gl.getParameter(told.UNMASKED_RENDERER_WEBGL) : "software";
    gl?.getExtension("WEBGL_lose_context")?.loseContext();
    return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name) ? "software" : "card";
  }

  // The line.
  let socket = null;
  let line = null; // the socket, once the server has said that it listens
  let tried = -Infinity;
  let lostSince = began;
  let unechoed = 0;
  let beats = 0;
  let presses = 0;
  let press = null; // the newest STOP that is not confirmed
  let server = null; // which one this page is of
  let same = true; // as far as is known, it is the one that viser hears
  let reloaded = -Infinity; // when that was asked for
  let known = null; // when viser had this page last
  let shutOut = false; // the server does not take this page's link any more
  let knocked = -Infinity;

  function open() {
    const opened = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/stop`);
    socket = opened;
    tried = performance.now();
    opened.onmessage = (event) => {
      if (socket !== opened) return;
      const said = JSON.parse(event.data);
      unechoed = 0;
      if ("line" in said) {
        line = opened;
        shutOut = false;
        nameStop();
        line.send(JSON.stringify({ page, of: server ?? "", ask: 0 }));
        if (press && performance.now() - press.at < LATEST_MS) line.send(JSON.stringify({ stop: press.number }));
      }
      if (press && said.stopped === press.number) press = null;
      if ("server" in said) recognise(said);
    };
    opened.onclose = () => {
      if (socket === opened) lose();
    };
  }

  // Another server knows nothing of this page, and viser comes back to the same one only in a page that is
  // looked at: the page is loaded anew.
  function recognise(said) {
    const now = performance.now();
    if (said.known) known = now;
    server ??= said.server;
    same = server === said.server;
    if (same && (known === null || now - known <= LEFT_MS)) return;
    if (now - reloaded < RELOAD_MS) return; // it is served by and by; to ask again would begin that anew
    reloaded = now;
    loadAnew();
  }
  // A server that is ending serves no page: the browser's own words would take the place of this one for good.
  async function loadAnew() {
    if ((await pageStatus()) === 200) location.reload();
    else reloaded = -Infinity;
  }

  // A browser does not tell why a line is refused. 0: nobody answers.
  async function pageStatus() {
    try {
      return (await fetch("/", { method: "HEAD", cache: "no-store" })).status;
    } catch {
      return 0;
    }
  }
  async function knock(now) {
    knocked = now;
    const status = await pageStatus();
    shutOut = !line && status === 401;
  }

  function lose() {
    if (line) lostSince = performance.now();
    const old = socket;
    socket = line = null;
    same = false;
    old.close();
  }

  function keepLine(now) {
    if (!line && now - lostSince > KNOCK_MS && now - knocked > KNOCK_MS) knock(now);
    if (!socket && now - tried > (shutOut ? KNOCK_MS : RETRY_MS)) open();
    else if (socket && !line && now - tried > OPENING_MS) lose();
    else if (line && ++unechoed > LOST_BEATS) lose();
    if (!line) return;
    line.send(JSON.stringify({ beat: ++beats, tabs: openTabs() }));
    if (beats % ASK_BEATS === 0) line.send(JSON.stringify({ ask: beats }));
  }

  // STOP.
  function stop() {
    press = { number: ++presses, at: performance.now() };
    if (line) line.send(JSON.stringify({ stop: press.number }));
    else if (globalThis.armctlTell?.({ do: "stop" })) press = null; // the state in the bar is its answer
    else document.body.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape", code: "Escape", bubbles: true }));
    // the last way: STOP is a hot key of viser's, too, and its connection may be alive
  }

  globalThis.armctlStop = stop; // a gamepad has one, too (sticks.js)

  addEventListener("keydown", (event) => event.isTrusted && event.key === "Escape" && !event.repeat && stop(), true);
  const pressed = (event) => {
    const button = event.target instanceof Element && event.target.closest(STOP);
    // a click that came from a pointer was counted when the pointer went down
    if (button && (event.type === "pointerdown" || event.detail === 0)) stop();
  };
  addEventListener("pointerdown", pressed, true);
  addEventListener("click", pressed, true);

  // What is shown.
  const told = document.createElement("div");
  told.id = "armctl-told";
  told.innerHTML = '<div role="status" id="armctl-watching" hidden></div><p role="alert" hidden></p>';
  const [banner, words] = told.children;
  document.addEventListener("DOMContentLoaded", () => {
    document.documentElement.append(told);
    frame(document.getElementById("armctl-under"));
  });

  // A window that is made larger or smaller gets the panels of its size (page.py).
  let resized = 0;
  addEventListener("resize", () => {
    clearTimeout(resized);
    resized = setTimeout(() => globalThis.armctlTell?.({ do: "window", value: `${innerWidth} ${innerHeight}` }), SETTLED_MS);
  });

  // What lies under the scene is as high as it is, and as wide as the scene (frame.css).
  function frame(under) {
    const set = (name, pixels) => document.documentElement.style.setProperty(name, `${pixels}px`);
    new ResizeObserver(() => set("--armctl-under", under.offsetHeight)).observe(under);
    new ResizeObserver(() => set("--armctl-told", told.offsetHeight)).observe(told); // messages lie above it
    viser("nameAtOnce");
    viser("onSceneEdges", (left, right) => {
      set("--armctl-left", left);
      set("--armctl-right", right);
    });
  }

  // STOP has its name, for those who read names, once its line is open: long before the page is built. It keeps it, as
  // STOP has other ways where that line is lost.
  function nameStop() {
    document.querySelector(STOP)?.removeAttribute("aria-hidden");
  }

  function say(element, text) {
    if (element.textContent !== text) element.textContent = text;
    element.hidden = !text;
  }

  viser("onScenePress", (long, ray, left, top) => {
    const value = [...ray, left, top].map((one) => one.toFixed(5)).join(" ");
    globalThis.armctlTell?.({ do: long ? "scene-press" : "scene-click", value });
  }, "/program/pin");
  viser("letGoOfLists"); // the keys that jog are pressed next

  function show(now) {
    if (now - began > OPENING_MS) nameStop();
    const lost = !line && now - Math.max(lostSince, began) > PATIENCE_MS;
    const unanswered = press && now - press.at > PATIENCE_MS;
    const cause = document.querySelector("[data-armctl-lost]")?.dataset.armctlLost;
    const gone = cause && cause[0].toUpperCase() + cause.slice(1);
    const text = lost ? (shutOut ? SHUT_OUT : globalThis.armctlTell?.() ? SECOND : LOST) : gone ? gone : unanswered ? UNANSWERED : draws ? "" : NO_3D;
    say(words, text);
    const operator = document.querySelector("[data-armctl-watching]")?.dataset.armctlWatching;
    say(banner, operator ? `WATCHING: ${operator} operates the arm` : "");
    viser("name");
    viser("furnishNotifications");
    const title = document.querySelector("[data-armctl-title]")?.dataset.armctlTitle;
    if (title && document.title !== title) document.title = title;
    viser("keepTabs", !document.documentElement.hasAttribute("data-armctl-parts-old"));
    giveBack();
    look();
  }

  // Beats come from this page's own thread, so they end when it hangs. A worker sets their pace: browsers
  // slow down the timers of a page in the background, but not a worker's, and a hidden page must not stop
  // the arm.
  let last = -Infinity;
  function tick() {
    const now = performance.now();
    if (now - last < BEAT_MS / 2) return; // several at once after the page was busy
    last = now;
    keepLine(now);
    show(now);
  }
  const pace = `setInterval(() => postMessage(0), ${BEAT_MS})`;
  new Worker(URL.createObjectURL(new Blob([pace], { type: "text/javascript" }))).onmessage = tick;
  open();
})();
