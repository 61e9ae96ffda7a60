// Parts of the page that armctl draws itself (parts.py). The server renders a part as HTML; this script puts it
// into <armctl-part name="…"> wherever one stands, changes only what differs, and tells the server what is done.
// It knows no part: data-do is what a click does, data-key to what.
(() => {
  "use strict";
  const RETRY_MS = [300, 3000]; // at first, and at most
  const texts = new Map(); // the newest HTML of each part
  let line = null;
  let retry = RETRY_MS[0];

  // The line: one websocket beside viser's.
  function open() {
    line = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/page`);
    line.onopen = () => tell({ page: armctlPage });
    line.onmessage = ({ data }) => {
      retry = RETRY_MS[0];
      document.documentElement.removeAttribute("data-armctl-parts-old");
      hear(JSON.parse(data).parts);
    };
    line.onclose = () => {
      document.documentElement.setAttribute("data-armctl-parts-old", "");
      texts.clear(); // of another arm, it may be
      setTimeout(open, retry);
      retry = Math.min(2 * retry, RETRY_MS[1]);
    };
  }
  function tell(said) {
    if (line.readyState === WebSocket.OPEN) line.send(JSON.stringify(said));
  }
  globalThis.armctlTell = tell; // a second way for STOP (overlay.js)
  function hear(parts) {
    for (const [name, html] of Object.entries(parts)) {
      texts.set(name, html);
      for (const part of document.querySelectorAll(`armctl-part[name="${CSS.escape(name)}"]`)) part.render();
    }
  }

  // A part fills itself, also where viser makes its element anew.
  customElements.define(
    "armctl-part",
    class extends HTMLElement {
      connectedCallback() {
        this.render();
      }
      render() {
        const wanted = document.createElement("template");
        wanted.innerHTML = texts.get(this.getAttribute("name")) ?? "";
        const focused = document.activeElement;
        change(this, wanted.content);
        if (focused !== document.activeElement && this.contains(focused)) focused.focus({ preventScroll: true });
      }
    },
  );

  // Make the children of a node those of another one, keeping every node that can be kept; rows have a key.
  function change(parent, wanted) {
    const keyed = new Map();
    for (const child of parent.children) if (child.dataset.key) keyed.set(rowOf(child), child);
    let at = parent.firstChild;
    for (const next of [...wanted.childNodes]) {
      const same = at && !at.dataset?.key && at.nodeName === next.nodeName ? at : null;
      const kept = next.dataset?.key ? keyed.get(rowOf(next)) : same;
      if (!kept) {
        parent.insertBefore(next, at);
        continue;
      }
      if (kept === at) at = at.nextSibling;
      else parent.insertBefore(kept, at);
      if (!kept.isEqualNode(next)) renew(kept, next);
    }
    while (at) {
      const gone = at;
      at = at.nextSibling;
      gone.remove();
    }
  }
  const rowOf = (node) => `${node.nodeName} ${node.dataset.key} ${node.dataset.do ?? ""}`;

  function renew(node, wanted) {
    if (node.nodeType === Node.TEXT_NODE) node.data = wanted.data;
    if (node.nodeType !== Node.ELEMENT_NODE) return;
    for (const { name } of [...node.attributes]) if (!wanted.hasAttribute(name)) node.removeAttribute(name);
    for (const { name, value } of wanted.attributes)
      if (node.getAttribute(name) !== value) node.setAttribute(name, value);
    // A field that somebody is in is theirs; another one shows what the server says, whatever was typed there.
    if (node.nodeName === "INPUT" && node !== document.activeElement) node.value = wanted.getAttribute("value");
    change(node, wanted);
  }

  // What is done, wherever it is done.
  const near = (event, selector) => (event.target instanceof Element ? event.target.closest(selector) : null);
  function act(element) {
    if (element.getAttribute("aria-disabled") !== "true") tell({ do: element.dataset.do, key: element.dataset.key ?? "" });
  }
  addEventListener("click", (event) => {
    const element = near(event, "armctl-part [data-do]:not(input)");
    if (element) act(element);
  });

  // Fields: their key is what they hold. A slider tells it while it is dragged, others once they are left or Enter
  // is pressed; then they show what the server has.
  const LEAST_MS = 100; // between two values of a slider
  let due = 0;
  addEventListener("input", (event) => {
    if (!event.target.matches?.("armctl-part input[type=range][data-do]")) return;
    clearTimeout(due);
    due = setTimeout(() => tellValue(event.target), LEAST_MS);
  });
  addEventListener("change", (event) => {
    if (!event.target.matches?.("armctl-part input[data-do]")) return;
    clearTimeout(due);
    tellValue(event.target);
  });
  addEventListener("focusout", (event) => {
    if (event.target.matches?.("armctl-part input[data-do]")) event.target.value = event.target.getAttribute("value");
  });
  const tellValue = (input) => tell({ do: input.dataset.do, key: input.value });

  // Hovering over something looks at it, until it is left. A finger does not hover.
  const HOVER_MS = 120;
  let hovered = null;
  let hovering = 0;
  addEventListener("pointerover", (event) => {
    const over = event.pointerType === "mouse" && !event.buttons ? near(event, "armctl-part [data-look]") : null;
    if (over === hovered) return;
    const { look } = (over ?? hovered).dataset;
    hovered = over;
    clearTimeout(hovering);
    hovering = setTimeout(() => tell({ do: look, key: over?.dataset.key ?? "" }), HOVER_MS);
  });

  // Lists by keyboard: arrows, Home and End choose; Enter and the space bar do what a click does.
  addEventListener("keydown", (event) => {
    const row = event.target;
    if (!(row instanceof Element) || !row.matches("armctl-part [role=listbox] > [data-key]")) return;
    if (event.altKey || event.ctrlKey || event.metaKey || event.shiftKey) return;
    const rows = Array.from(row.parentElement.children).filter((one) => one.dataset.key);
    const at = rows.indexOf(row);
    const columns = rows.filter((one) => one.offsetTop === rows[0].offsetTop).length;
    const forth = { ArrowRight: 1, ArrowDown: columns, ArrowLeft: -1, ArrowUp: -columns }[event.key];
    const to = { Home: 0, End: rows.length - 1 }[event.key] ?? (forth === undefined ? undefined : at + forth);
    if (to !== undefined && rows[to]) {
      rows[to].focus();
      act(rows[to]);
    } else if (event.key === "Enter" || event.key === " ") act(row);
    else if (to === undefined) return;
    event.preventDefault();
    event.stopPropagation(); // keys that jog
  }, true);

  open();
})();
