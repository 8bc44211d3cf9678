// What the three tabs share: requests of which the newest wins, tabs, light and dark, numbers of a stone.
"use strict";
window.lithoform = window.lithoform || {};
window.dash_clientside = window.dash_clientside || {};

(() => {
  const page = Array.from(crypto.getRandomValues(new Uint8Array(16)), (b) => b.toString(16).padStart(2, "0")).join("");
  const turns = {}, running = {}, brought = new Set();

  const $ = lithoform.$ = (id) => document.getElementById(id);

  // An element of a name, with attributes and children.
  lithoform.make = (name, attributes = {}, ...children) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) {
      if (key in made && typeof value !== "string") made[key] = value;
      else made.setAttribute(key, value);
    }
    made.append(...children);
    return made;
  };

  lithoform.say = (text) => { const status = $("status"); if (status) status.textContent = text; };

  // What must not be overlooked, until it is closed.
  lithoform.notice = (text) => {
    const notice = $("notice"), close = lithoform.make("button", { type: "button" }, "Close");
    close.addEventListener("click", () => { notice.hidden = true; });
    notice.replaceChildren(lithoform.make("span", {}, text), close);
    notice.hidden = false;
  };

  async function post(path, body, signal) {
    const answer = await fetch(`/api/${path}`, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body), signal,
    });
    if (!answer.ok) throw new Error((await answer.text()).slice(0, 300) || `the server answered ${answer.status}.`);
    const kind = answer.headers.get("Content-Type") || "";
    if (answer.headers.has("X-Filename")) return { name: answer.headers.get("X-Filename"), blob: await answer.blob() };
    if (kind.startsWith("application/json")) return answer.json();
    return unpack(await answer.arrayBuffer());
  }

  // As lithoform.explorer.stones.pack wrote it.
  function unpack(content) {
    const [text, n, m] = new Uint32Array(content, 0, 3);
    return {
      told: JSON.parse(new TextDecoder().decode(new Uint8Array(content, 12, text))),
      vertices: new Float32Array(content, 12 + text, 3 * n),
      faces: new Uint32Array(content, 12 + text + 12 * n, 3 * m),
    };
  }

  // Ask; a newer request of the same channel ends this one, which then gives null.  Faults are told, and give null.
  lithoform.ask = async (path, body, { channel = null, what = "", turn = null, told = lithoform.say } = {}) => {
    let signal = null;
    if (channel && turn === null) {
      turn = lithoform.newTurn(channel);
      signal = running[channel].signal;
    } else if (channel) {
      if (turn !== turns[channel]) return null;
      signal = running[channel].signal;
    }
    const started = performance.now();
    const slow = what ? setTimeout(() => lithoform.say(what), 150) : null;
    try {
      const found = await post(path, { page, turn, ...body }, signal);
      if (found.superseded || (channel && turn !== turns[channel])) return null;
      if (found.error) { told(found.error, true); return null; }
      found.milliseconds = performance.now() - started;
      return found;
    } catch (fault) {
      if (fault.name !== "AbortError") told(`The explorer's server does not answer (${fault.message}).`);
      return null;
    } finally {
      clearTimeout(slow);
      if (what && $("status") && $("status").textContent === what) lithoform.say("");
    }
  };

  lithoform.newTurn = (channel) => {
    if (running[channel]) running[channel].abort();
    running[channel] = new AbortController();
    turns[channel] = (turns[channel] || 0) + 1;
    return turns[channel];
  };

  lithoform.turnOf = (channel) => turns[channel];
  lithoform.isTurn = (channel, turn) => turns[channel] === turn;

  // The server, too, drops what waits.
  lithoform.cancel = (channel) => {
    const turn = lithoform.newTurn(channel);
    return post("cancel", { page, channel, turn }).catch(() => null);
  };

  window.addEventListener("pagehide", () => {
    navigator.sendBeacon("/api/close", new Blob([JSON.stringify({ page })], { type: "application/json" }));
  });
  // A page that comes back from the browser's memory has been closed on the server.
  window.addEventListener("pageshow", (event) => { if (event.persisted) location.reload(); });

  // Tabs: arrow keys go from one to the next, and the address remembers the one that is open.
  const tabs = () => [...document.querySelectorAll("[role=tab]")];
  lithoform.open = (name) => {
    for (const tab of tabs()) {
      const chosen = tab.id === `tab-${name}`;
      tab.setAttribute("aria-selected", chosen);
      tab.tabIndex = chosen ? 0 : -1;
      $(tab.getAttribute("aria-controls")).hidden = !chosen;
    }
    lithoform.tab = name;
    lithoform.remember();
    if (name === "studio") lithoform.openedStudio();
    else if (!brought.has(name)) { brought.add(name); dash_clientside.set_props(`opened-${name}`, { data: 1 }); }
    if (name === "population") lithoform.openedPopulation();
    window.dispatchEvent(new Event("resize"));
  };
  lithoform.remember = () => {
    const link = lithoform.link || "";
    const query = [lithoform.tab && lithoform.tab !== "space" ? `tab=${lithoform.tab}` : "", link].filter(Boolean);
    history.replaceState(null, "", query.length ? `?${query.join("&")}` : location.pathname);
  };

  function connectTabs() {
    for (const tab of tabs()) tab.addEventListener("click", () => lithoform.open(tab.id.slice(4)));
    document.querySelector("[role=tablist]").addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;  // the browser's own
      const all = tabs(), here = all.indexOf(document.activeElement);
      const next = { ArrowRight: here + 1, ArrowLeft: here - 1, Home: 0, End: all.length - 1 }[event.key];
      if (here < 0 || next === undefined) return;
      event.preventDefault();
      const chosen = all[(next + all.length) % all.length];
      chosen.focus();
      chosen.click();
    });
  }

  // Descriptors of a stone as a table; further columns by name, functions of the descriptor.
  const SHOWN = ["roundness", "boxiness", "solidity", "true_sphericity", "elongation", "flatness", "length", "width",
    "thickness", "volume", "surface_area"];
  const SYMBOLS = { roundness: "R", boxiness: "B", solidity: "S_3D", true_sphericity: "TS", elongation: "EI",
    flatness: "FI" };
  const POWERS = { length: 1, width: 1, thickness: 1, volume: 3, surface_area: 2 };
  const UNITS = { 1: [["m", 1], ["mm", 1e3], ["µm", 1e6]], 2: [["m²", 1], ["cm²", 1e4], ["mm²", 1e6]],
    3: [["m³", 1], ["cm³", 1e6], ["mm³", 1e9]] };

  // A length, area or volume in the largest unit in which it is at least 1.
  function sized(value, power) {
    const [unit, factor] = UNITS[power].find(([, per]) => value * per >= 1) || UNITS[power][2];
    return `${Number((value * factor).toPrecision(4))} ${unit}`;
  }

  // A symbol in italics, Greek letters as such, with what follows an underscore below the line.
  const GREEK = { eta: "η", delta: "δ", lambda: "λ", alpha: "α", beta: "β", gamma: "γ", kappa: "κ", rho: "ρ", mu: "μ" };
  lithoform.symbol = (ascii) => {
    const [main, below] = (ascii === "p0" ? "p_0" : ascii).split("_");
    return lithoform.make("i", {}, GREEK[main] || main, ...(below ? [lithoform.make("sub", {}, below)] : []));
  };

  // A number without a minus sign before nothing.
  lithoform.fixed = (value) => value.toFixed(3).replace(/^-(0\.0*)$/, "$1");

  lithoform.numbers = (descriptors, columns = {}, names = SHOWN, isShort = false) => {
    const { make } = lithoform;
    const head = make("tr", {}, make("th", { scope: "col" }, "descriptor"), make("th", { scope: "col" }, "value"),
      ...Object.keys(columns).map((name) => make("th", { scope: "col" }, name)));
    const rows = names.filter((name) => name in descriptors).map((name) => {
      const power = POWERS[name], value = descriptors[name], long = name.replaceAll("_", " ");
      const text = power ? sized(value, power) : lithoform.fixed(value);
      const symbol = SYMBOLS[name] ? [lithoform.symbol(SYMBOLS[name])] : [];
      const label = isShort ? symbol : [long, " ", ...symbol];
      return make("tr", {}, make("th", { scope: "row", title: long }, ...label), make("td", {}, text),
        ...Object.values(columns).map((of) => make("td", {}, of(name))));
    });
    return make("table", { class: "numbers" }, head, ...rows);
  };

  const themeNow = () => localStorage.getItem("lithoform-theme")
    || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  // At once, so that nothing flashes up in the other.
  document.documentElement.dataset.theme = themeNow();

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    if (localStorage.getItem("lithoform-theme")) return;
    document.documentElement.dataset.theme = themeNow();
    $("theme-button").textContent = themeNow() === "dark" ? "Light" : "Dark";
    dash_clientside.set_props("theme", { data: themeNow() });
  });

  window.dash_clientside.explorer = {
    start: () => {
      connectTabs();
      lithoform.startStudio();
      lithoform.startOthers();
      const name = new URLSearchParams(location.search).get("tab");
      const hasRecipe = [...new URLSearchParams(location.search).keys()].some((key) => key !== "tab");
      // The link is read by the studio before the address is touched.
      lithoform.open(["space", "studio", "population"].includes(name) ? name : hasRecipe ? "studio" : "space");
      return 1;
    },
    theme: (clicks) => {
      const theme = themeNow(), next = clicks ? (theme === "dark" ? "light" : "dark") : theme;
      if (clicks) localStorage.setItem("lithoform-theme", next);
      document.documentElement.dataset.theme = next;
      $("theme-button").textContent = next === "dark" ? "Light" : "Dark";
      return next;
    },
    pick: (clicked, drawn) => {
      const point = clicked && clicked.points && clicked.points[0];
      // The target and the baseline are no designs.
      const index = point && drawn && drawn[point.curveNumber] && drawn[point.curveNumber][point.pointNumber];
      if (Number.isInteger(index)) lithoform.showPoint(index);
      return "";
    },
    sheet: (source, shape) => { lithoform.showSheet(source, shape, 0); return ""; },
  };
})();
