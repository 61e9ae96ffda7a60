// The search of the documentation, in the browser alone: the server gives every section's text once, and the
// sections that have all words that are typed are listed, those with the words in their headings first. Beside it,
// what a page needs to be used by keys and on a phone.
(() => {
  "use strict";
  const MOST = 30;
  const LATE_MS = 300; // after that the reader is told that it goes on
  const AROUND = 70; // letters of the text on each side of a word
  const form = document.getElementById("search");
  const field = document.getElementById("find");
  const results = document.getElementById("results");
  const list = document.getElementById("found");
  const status = results.querySelector("[role=status]");
  let sections = null; // once they are asked for: [address, page, heading, text] of each

  const pages = document.querySelector("nav details");
  const narrow = matchMedia("(max-width: 56em)");
  const fold = () => (pages.open = !narrow.matches);
  narrow.addEventListener("change", fold);
  fold(); // on a phone the list of pages begins folded
  const here = pages.querySelector("[aria-current]");
  if (here) pages.parentElement.scrollTop = here.offsetTop - pages.parentElement.clientHeight / 3;

  // Tables and code that are wider than the page move by arrow keys, too.
  const wide = new ResizeObserver((entries) => {
    for (const { target } of entries)
      if (target.scrollWidth > target.clientWidth) target.tabIndex = 0;
      else target.removeAttribute("tabindex");
  });
  for (const one of document.querySelectorAll("pre, .wide")) wide.observe(one);
  form.hidden = false;

  async function load() {
    sections ??= fetch("/docs/search.json").then((answer) => {
      if (!answer.ok) throw new Error(answer.status);
      return answer.json();
    });
    return sections;
  }

  // How well a section answers: 0 where a word is missing.
  function worth([, page, heading, text], words) {
    const head = `${page} ${heading}`.toLowerCase();
    const all = `${head} ${text}`.toLowerCase();
    if (!words.every((word) => all.includes(word))) return 0;
    const phrase = words.join(" ");
    const inHead = words.filter((word) => head.includes(word)).length;
    return 1 + 2 * inHead + (all.includes(phrase) ? 1 : 0) + (heading.toLowerCase() === phrase ? 9 : 0);
  }

  // A line of the text around the words, with each of them marked.
  function excerpt(text, words) {
    const low = text.toLowerCase();
    const places = [words.join(" "), ...words].map((one) => low.indexOf(one));
    const at = places[0] >= 0 ? places[0] : Math.min(...places.filter((one) => one >= 0), text.length);
    const begin = at > AROUND && at < text.length ? text.indexOf(" ", at - AROUND) + 1 : 0;
    const room = text.slice(begin, begin + 2 * AROUND);
    const shown = begin + room.length < text.length ? room.slice(0, room.lastIndexOf(" ")) : room;
    const line = document.createElement("span");
    line.append(begin ? "… " : "");
    let done = 0;
    while (done < shown.length) {
      const rest = shown.slice(done).toLowerCase();
      const next = words.map((word) => [rest.indexOf(word), word.length]).filter(([where]) => where >= 0);
      if (!next.length) break;
      const [where, length] = next.reduce((a, b) => (b[0] < a[0] ? b : a));
      const mark = document.createElement("mark");
      mark.textContent = shown.slice(done + where, done + where + length);
      line.append(shown.slice(done, done + where), mark);
      done += where + length;
    }
    line.append(shown.slice(done), begin + shown.length < text.length ? " …" : "");
    return line;
  }

  function row([address, page, heading, text], words) {
    const link = document.createElement("a");
    link.href = address;
    const name = document.createElement("b");
    name.textContent = !heading || heading === page ? page : `${page}: ${heading}`;
    link.append(name, excerpt(text, words));
    const item = document.createElement("li");
    item.append(link);
    return item;
  }

  async function search() {
    const typed = field.value;
    const words = typed.toLowerCase().split(/\s+/).filter(Boolean);
    results.hidden = !words.length;
    if (!words.length) return;
    let known;
    const late = setTimeout(() => (status.textContent = "Searching all pages …"), LATE_MS);
    try {
      known = await load();
    } catch {
      sections = null; // asked for again with the next letter
      list.replaceChildren();
      status.textContent = "The search needs the console: see that armctl runs.";
      return;
    } finally {
      clearTimeout(late);
    }
    if (typed !== field.value) return; // newer letters are searched for
    const found = known.map((one) => [worth(one, words), one]).filter(([value]) => value);
    found.sort(([a], [b]) => b - a);
    const more = found.length > MOST ? `, the best ${MOST} are shown` : "";
    status.textContent = found.length ? `Found: ${found.length}${more}` : "Nothing is found.";
    list.replaceChildren(...found.slice(0, MOST).map(([, one]) => row(one, words)));
  }

  // From the field down into the results and back by arrow keys; Escape ends the search.
  function move(event) {
    const links = [field, ...list.querySelectorAll("a")];
    const at = links.indexOf(document.activeElement);
    const to = { ArrowDown: at + 1, ArrowUp: at - 1 }[event.key];
    if (event.key === "Escape") {
      field.value = "";
      field.focus();
      search();
    } else if (at >= 0 && to !== undefined && links[to]) {
      links[to].focus();
      event.preventDefault();
    }
  }

  field.addEventListener("focus", () => load().catch(() => (sections = null)));
  field.addEventListener("input", search);
  form.addEventListener("keydown", move);
  results.addEventListener("keydown", move);
  results.addEventListener("click", (event) => {
    if (event.target.closest("a")) results.hidden = true; // it may lead into this page
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    list.querySelector("a")?.click();
  });
  addEventListener("keydown", (event) => {
    if (event.key !== "/" || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.matches?.("input")) return;
    event.preventDefault();
    field.focus();
  });
})();
