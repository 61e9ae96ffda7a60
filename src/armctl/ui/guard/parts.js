// Parts of the page that armctl draws itself (parts.py). The server renders a part as HTML; this script puts it
// into <armctl-part name="…"> wherever one stands, changes only what differs, and tells the server what is done.
// It knows no part:
//   data-do      what a click does; data-key to what
//   data-set     what a field does once something is typed or chosen there; data-enter what Enter does then, too
//   data-wheel   what the wheel does over it; with data-held only while the focus is in it
//   data-focus   what has the focus when it comes into a list that has it
//   data-rows    a long list, whose rows come by key; its rows are what data-key is on
//     data-keys  "chord:what chord:what": what keys do to the row that has the focus
//     data-twice what a double click does to a row; data-moves what a drag by [data-grip] does
//     data-view  the key of the row that is to be in view when that changes, or data-again does; data-nth a row's number,
//                written here
(() => {
  "use strict";
  const RETRY_MS = [300, 3000]; // at first, and at most
  const AROUND = 5; // how far up what is around a part is marked
  const EDGE_PX = 28; // a row that is dragged so near to the end of its list scrolls it
  const texts = new Map(); // the newest HTML of each part
  const lists = new Map(); // of each list: the order of its rows, the HTML of each, and which have changed
  let line = null;
  let unanswered = 0; // how much of what was told the server has not done yet
  let press = { left: 0, at: 0 }; // how much of that up to the last button, and when that was
  let retry = RETRY_MS[0];
  let drawn = false;

  // The line: one websocket beside viser's.
  function open() {
    line = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/page`);
    line.onopen = () => {
      unanswered = 0;
      tell({ page: armctlPage, load: armctlLoad });
    };
    line.onmessage = ({ data }) => {
      retry = RETRY_MS[0];
      document.documentElement.removeAttribute("data-armctl-parts-old");
      hear(JSON.parse(data));
      if (!drawn) requestAnimationFrame(() => setTimeout(() => tell({ do: "drawn" }))); // once it is on the screen
      drawn = true;
    };
    line.onclose = () => {
      if (press.left > 0 && performance.now() - press.at < WHY_MS) sayWhy(LOST);
      press.left = 0;
      document.documentElement.setAttribute("data-armctl-parts-old", "");
      texts.clear(); // of another arm, it may be
      lists.clear();
      setTimeout(open, retry);
      retry = Math.min(2 * retry, RETRY_MS[1]);
    };
  }
  function tell(said) {
    if (line.readyState !== WebSocket.OPEN) return false;
    if (said.do) unanswered++;
    line.send(JSON.stringify(said));
    return true;
  }
  // A second way for STOP (overlay.js): whether it goes; without something to say whether it would.
  globalThis.armctlTell = (said) => (said ? tell(said) : line.readyState === WebSocket.OPEN);
  function hear({ parts, rows = {}, done }) {
    unanswered -= done;
    press.left -= done;
    for (const [name, { order, html }] of Object.entries(rows)) {
      const list = lists.get(name) ?? { order: [], html: new Map(), changed: new Set(), moved: true };
      lists.set(name, list);
      for (const [key, text] of Object.entries(html)) {
        list.html.set(key, text);
        list.changed.add(key);
      }
      if (!order) continue;
      list.order = order;
      list.moved = true;
      if (list.html.size > order.length) {
        const kept = new Set(order);
        for (const key of list.html.keys()) if (!kept.has(key)) list.html.delete(key);
      }
    }
    for (const [name, html] of Object.entries(parts)) {
      texts.set(name, html);
      for (const part of document.querySelectorAll(`armctl-part[name="${CSS.escape(name)}"]`)) part.render();
    }
    refill();
  }

  // A part fills itself, also where viser makes its element anew.
  customElements.define(
    "armctl-part",
    class extends HTMLElement {
      connectedCallback() {
        // Styles of what is around it need no :has, by which each change of a long list would style all of it anew.
        const name = this.getAttribute("name");
        let around = /^\w+$/.test(name) ? this.parentElement : null;
        for (let up = 1; around && up <= AROUND; up++, around = around.parentElement) around.setAttribute(`data-around-${name}`, up);
        this.render();
        for (const place of this.querySelectorAll("[data-rows]")) fill(place);
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
      else put(parent, kept, at);
      if (!kept.isEqualNode(next) || kept.matches?.("input, select")) renew(kept, next);
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
    if (!node.dataset.rows) change(node, wanted);
    if (node.matches("input, select")) show(node, wanted.value);
  }

  // A long list: only rows that have changed are made anew, and only those that have moved are moved.
  function refill() {
    if (drag) return; // what is dragged is drawn anew once it is dropped
    for (const place of document.querySelectorAll("armctl-part [data-rows]")) fill(place);
    for (const list of lists.values()) {
      list.changed.clear();
      list.moved = false;
    }
  }
  function fill(place) {
    const { order, html, changed, moved } = lists.get(place.dataset.rows) ?? { order: [], html: new Map(), moved: true };
    const anew = place.childElementCount !== order.length; // or viser has made the list's element anew
    const focused = place.contains(document.activeElement) ? document.activeElement : null;
    const make = document.createElement("template");
    const made = (key) => ((make.innerHTML = html.get(key)), make.content.firstElementChild);
    if (moved || anew) {
      const rows = new Map(Array.from(place.children, (row) => [row.dataset.key, row]));
      const wanted = new Set(order);
      for (const [key, row] of rows) if (!wanted.has(key)) row.remove();
      let at = place.firstElementChild;
      for (const key of order) {
        const row = rows.get(key);
        if (row && row === at?.nextElementSibling) at = row; // the one before it has moved away: its turn comes
        if (!row) place.insertBefore(made(key), at);
        else if (row === at) at = at.nextElementSibling;
        else put(place, row, at);
      }
      Array.from(place.children, (row, i) => number(row, i + 1));
    }
    for (const key of changed ?? []) {
      const row = place.querySelector(`:scope > [data-key="${CSS.escape(key)}"]`);
      const wanted = row && made(key);
      if (!wanted) continue;
      number(wanted, row.querySelector("[data-nth]")?.textContent ?? "");
      const was = wanted.querySelector("[data-set]") ? row.offsetHeight : Infinity;
      renew(row, wanted);
      if (was < Infinity && row.offsetHeight > was) view(place, row); // what was unfolded is seen
    }
    if (focused || document.activeElement === document.body) keepFocus(place, focused);
    keepInView(place);
    sized.observe(place);
  }
  // Without its losing the focus, where the browser can.
  function put(place, row, at) {
    if (place.moveBefore) place.moveBefore(row, at);
    else place.insertBefore(row, at);
  }
  function number(row, n) {
    const nth = row.querySelector("[data-nth]");
    if (nth && nth.textContent !== String(n)) nth.textContent = n;
  }

  // The focus goes with the row that the server has selected, once it has done all that it was told: until then
  // who presses keys is ahead of it. What asks for the focus as it comes gets it.
  const asked = new WeakSet();
  function keepFocus(place, focused) {
    const asks = place.querySelector("[data-focus]");
    if (asks && !asked.has(asks)) {
      asked.add(asks);
      asks.focus({ preventScroll: true });
      asks.select?.();
      view(place, asks.closest("[data-rows] > *"));
      return;
    }
    if (!focused) return;
    const stays = focused.isConnected && (unanswered > 0 || focused.parentElement !== place);
    const to = stays ? focused : place.querySelector(":scope > [tabindex='0']");
    if (to && to !== document.activeElement) to.focus({ preventScroll: true });
  }

  // In view of its own list only: the page around it stays, but on a phone. Who types there is not scrolled away.
  const viewed = new WeakMap();
  const viewedRow = (place) => place.dataset.view && place.querySelector(`:scope > [data-key="${CSS.escape(place.dataset.view)}"]`);
  function keepInView(place) {
    const wanted = `${place.dataset.view} ${place.dataset.again}`;
    const row = viewed.get(place) !== wanted && viewedRow(place);
    if (!row || !place.clientHeight || document.activeElement.matches("[data-set]")) return;
    viewed.set(place, wanted);
    view(place, row);
  }
  // What opens below a list that scrolls takes room from it: the row stays in view.
  const heights = new WeakMap();
  const sized = new ResizeObserver((lists) => {
    for (const { target } of lists) {
      const [was, height] = [heights.get(target), target.clientHeight];
      heights.set(target, height);
      const row = height < was && target.scrollHeight > height && viewedRow(target);
      if (row && !document.activeElement.matches("[data-set]")) view(target, row);
    }
  });
  function view(place, row) {
    for (let pass = 0; pass < 2; pass++) { // rows that are drawn for the first time may be higher than was thought
      const [box, at] = [place.getBoundingClientRect(), row.getBoundingClientRect()];
      if (at.top < box.top) place.scrollTop -= box.top - at.top;
      else if (at.bottom > box.bottom) place.scrollTop += Math.min(at.bottom - box.bottom, at.top - box.top);
    }
    // On a phone the sheet around it scrolls, too: to who looks at the list.
    if (!matchMedia("(max-width: 36em)").matches || !place.checkVisibility?.()) return;
    let sheet = place.parentElement;
    while (sheet && !(sheet.scrollHeight > sheet.clientHeight && /auto|scroll/.test(getComputedStyle(sheet).overflowY))) sheet = sheet.parentElement;
    const [list, seen] = [place.getBoundingClientRect(), sheet?.getBoundingClientRect()];
    if (seen && list.top < seen.bottom && list.bottom > seen.top) row.scrollIntoView({ block: "nearest" });
  }

  // What is done, wherever it is done.
  const near = (event, selector) => (event.target instanceof Element ? event.target.closest(selector) : null);
  const keyOf = (element) => element.dataset.key ?? "";
  function act(element) {
    if (element.getAttribute("aria-disabled") === "true") sayWhy(element.title);
    else if (tell({ do: element.dataset.do, key: keyOf(element) })) press = { left: unanswered, at: performance.now() };
    else sayWhy(LOST);
  }

  // Why something cannot be pressed: a finger sees no title.
  const WHY_MS = 5000;
  const LOST = "The page lost its line to armctl: what was pressed last may not have arrived. Look at the arm, then press it again.";
  let saidWhy = 0;
  function sayWhy(text) {
    const place = document.getElementById("armctl-why");
    if (!place || !text) return;
    place.textContent = text[0].toUpperCase() + text.slice(1);
    clearTimeout(saidWhy);
    saidWhy = setTimeout(() => (place.textContent = ""), WHY_MS);
  }
  // What is open for a moment is left by a press anywhere else, and by Escape, which is STOP as well.
  const leave = ({ target, key }) => {
    const open = document.querySelector("armctl-part [data-leave]");
    if (open && (key === "Escape" || (!key && !open.contains(target)))) tell({ do: open.dataset.leave });
  };
  addEventListener("pointerdown", leave, true);
  addEventListener("keydown", leave, true);
  // A key that is held down presses no button again.
  addEventListener("keydown", (event) => {
    if (event.repeat && (event.key === "Enter" || event.key === " ") && near(event, "armctl-part button[data-do]")) event.preventDefault();
  }, true);
  // The second click of two is for the row of the first, whatever has moved in between.
  let clicked = null;
  addEventListener("click", (event) => {
    const element = near(event, "armctl-part [data-do]");
    const twice = clicked?.parentElement?.dataset.twice;
    if (event.detail === 2 && twice && near(event, "[data-rows]") === clicked.parentElement) {
      tell({ do: twice, key: keyOf(clicked) });
      clicked.focus({ preventScroll: true });
    } else if (element && !near(event, "[data-set]")) act(element);
    clicked = element?.matches("[data-rows] > *") && !near(event, "[data-set]") ? element : null;
  });

  // Fields: what is typed is told when it is left, or by Enter. A field that somebody is in is theirs.
  const told = new WeakMap();
  function say(field) {
    if (told.get(field) === field.value) return;
    told.set(field, field.value);
    tell({ do: field.dataset.set, key: keyOf(field), value: field.value });
  }
  function show(field, value) {
    if (field === document.activeElement && field.value !== told.get(field)) return;
    if (field.value !== value) field.value = value;
    told.delete(field);
  }
  addEventListener("change", (event) => {
    const field = near(event, "armctl-part [data-set]");
    if (field) say(field);
  });

  const LEAST_MS = 100; // so long a slider rests before it tells
  let due = 0;
  addEventListener("input", (event) => {
    const slider = near(event, "armctl-part input[type=range][data-set]");
    if (!slider) return;
    clearTimeout(due);
    due = setTimeout(() => say(slider), LEAST_MS);
  });

  // The wheel over something: where, of its width, and how many notches down and to the right.
  const [NOTCH_PX, WHEEL_MS] = [100, 60];
  let turned = null;
  addEventListener("wheel", (event) => {
    const place = near(event, "armctl-part [data-wheel]");
    if (!place || ("held" in place.dataset && !place.contains(document.activeElement))) return;
    event.preventDefault();
    const box = place.getBoundingClientRect();
    if (!turned) setTimeout(() => {
      const { what, at, down, right } = turned;
      turned = null;
      tell({ do: what, value: [at, down / NOTCH_PX, right / NOTCH_PX].map((one) => one.toFixed(4)).join(" ") });
    }, WHEEL_MS);
    const [across, along] = event.shiftKey ? [event.deltaY, 0] : [event.deltaX, event.deltaY];
    const { down = 0, right = 0 } = turned ?? {};
    turned = { what: place.dataset.wheel, at: (event.clientX - box.left) / box.width, down: down + along, right: right + across };
  }, { passive: false });

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

  // Lists by keyboard: arrows, Home and End choose; Enter and the space bar do what a click does, and other keys
  // what the list says.
  const chordOf = (event) =>
    ["Ctrl", "Alt", "Shift"].filter((name) => event[`${name.toLowerCase()}Key`]).concat(event.key.length > 1 ? event.key : event.key.toLowerCase()).join("+");
  function doesOf(list, chord) {
    const does = (list.dataset.keys ?? "").split(" ").map((one) => one.split(":"));
    return does.find(([key]) => key === chord)?.[1];
  }
  function chosenBy(event, row, list) {
    if (event.altKey || event.ctrlKey || event.metaKey || event.shiftKey) return undefined;
    if (event.key === "Home") return list.firstElementChild;
    if (event.key === "End") return list.lastElementChild;
    if (list.matches("[role=grid]")) return { ArrowDown: row.nextElementSibling, ArrowUp: row.previousElementSibling }[event.key];
    const rows = Array.from(list.children).filter((one) => one.dataset.key);
    const columns = rows.filter((one) => one.offsetTop === rows[0].offsetTop).length;
    const forth = { ArrowRight: 1, ArrowDown: columns, ArrowLeft: -1, ArrowUp: -columns }[event.key];
    return forth && (rows[rows.indexOf(row) + forth] ?? null);
  }
  addEventListener("keydown", (event) => {
    const row = event.target;
    if (!(row instanceof Element) || event.isComposing) return;
    if (event.key === "Enter" && row.matches("armctl-part [data-enter]")) {
      say(row);
      tell({ do: row.dataset.enter, key: keyOf(row) });
    } else if (row.matches("armctl-part :is([role=listbox], [role=grid]) > [data-key]")) {
      const list = row.parentElement;
      const to = chosenBy(event, row, list);
      const does = event.metaKey ? undefined : doesOf(list, chordOf(event));
      const plain = !(event.altKey || event.ctrlKey || event.metaKey || event.shiftKey);
      if (to) {
        to.focus();
        act(to);
      } else if (does) tell({ do: does, key: keyOf(row) });
      else if (plain && (event.key === "Enter" || event.key === " ")) act(row);
      else if (to === undefined) return;
    } else return;
    event.preventDefault();
    event.stopPropagation(); // keys that jog
  }, true);

  // A row is dragged by its grip, and dropped before another one, or at the end.
  let drag = null;
  addEventListener("pointerdown", (event) => {
    const grip = near(event, "[data-rows][data-moves] > [data-key] [data-grip]");
    if (!grip || event.button || drag) return;
    event.preventDefault(); // no text is selected
    const row = grip.closest("[data-rows] > *");
    row.focus({ preventScroll: true });
    const place = row.parentElement;
    drag = { pointer: event.pointerId, row, place, over: null, y: event.clientY, scrolls: 0 };
    grip.setPointerCapture(event.pointerId);
    row.classList.add("armctl-dragged");
  });
  function dragTo(y) {
    const { place, row } = drag;
    const box = place.getBoundingClientRect();
    const inside = Math.min(Math.max(y, box.top + 2), box.bottom - 2);
    const other = document.elementsFromPoint(box.left + box.width / 2, inside).map((one) => one.closest("[data-rows] > *")).find((one) => one?.parentElement === place);
    const at = (other ?? place.lastElementChild).getBoundingClientRect();
    const over = other && y < at.top + at.height / 2 ? other : (other ?? place.lastElementChild).nextElementSibling;
    drag.over = over === row ? row.nextElementSibling : over;
    for (const one of place.querySelectorAll(".armctl-drop, .armctl-drop-end")) one.classList.remove("armctl-drop", "armctl-drop-end");
    if (drag.over === row.nextElementSibling) return; // it stays where it is
    if (drag.over) drag.over.classList.add("armctl-drop");
    else place.lastElementChild.classList.add("armctl-drop-end");
  }
  function scrollAlong() {
    if (!drag) return;
    const box = drag.place.getBoundingClientRect();
    const by = Math.min(0, drag.y - box.top - EDGE_PX) + Math.max(0, drag.y - box.bottom + EDGE_PX);
    drag.scrolls = by ? requestAnimationFrame(scrollAlong) : 0;
    if (!by) return;
    drag.place.scrollTop += by / 3;
    dragTo(drag.y);
  }
  addEventListener("pointermove", (event) => {
    if (event.pointerId !== drag?.pointer) return;
    drag.y = event.clientY;
    drag.moved = true;
    dragTo(event.clientY);
    if (!drag.scrolls) scrollAlong();
  });
  function drop(event) {
    if (event.pointerId !== drag?.pointer) return;
    const { place, row, over, moved } = drag;
    drag = null;
    for (const one of place.children) one.classList.remove("armctl-dragged", "armctl-drop", "armctl-drop-end");
    if (event.type === "pointerup" && moved && over !== row.nextElementSibling)
      tell({ do: place.dataset.moves, key: keyOf(row), value: over ? keyOf(over) : "" });
    refill();
  }
  addEventListener("pointerup", drop);
  addEventListener("pointercancel", drop);

  open();
})();
