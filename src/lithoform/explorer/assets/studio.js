// The studio: controls of every field of a recipe, and the stone redrawn as they change.
"use strict";
window.lithoform = window.lithoform || {};

(() => {
  const { $, make } = { $: (id) => document.getElementById(id), make: (...all) => lithoform.make(...all) };
  // WAIT gathers what changes at once; a request younger than PATIENCE is let finish, so that a slider that is drawn along
  // shows stones on its way [ms].
  const STEPS = 1000, WAIT = 20, PATIENCE = 300, ONE_MOVE = 600;
  const controls = {}, past = [], future = [];
  let about = null, recipe = null, view = null, timer = null, since = 0, changed = null, measured = null, flight = 0;
  // The recipe of the stone that is shown, and whether the controls hold one that was refused since.
  let drawn = null, isRefused = false;

  const scales = {
    linear: [(x) => x, (x) => x], log: [Math.log, Math.exp], square_root: [Math.sqrt, (x) => x * x],
  };
  const isSame = (one, other) => JSON.stringify(one) === JSON.stringify(other);
  const short = (value) => String(Number(value.toPrecision(4)));

  function slider(control, set) {
    const [down, up] = scales[control.scale], low = down(control.low), width = down(control.high) - low;
    const id = `slide-${control.name}`;
    const range = make("input", { type: "range", id, min: "0", max: String(STEPS), step: "1" });
    const field = make("input", { type: "number", id: `field-${control.name}`, step: "any",
      "aria-label": `${control.name.replaceAll("_", " ")}, number` });
    if (control.whole && control.scale === "linear") range.max = String(control.high - control.low);
    range.addEventListener("input", () => {
      const value = up(low + width * range.value / range.max), now = recipe[control.name];
      if (!control.whole) { set(Number(short(value))); return; }
      // A step of the slider may be less than one: it is one then, in the direction of the move.
      const whole = Math.round(value), up_or_down = Math.sign(value - now);
      set(whole === now ? Math.min(Math.max(now + up_or_down, control.low), control.high) : whole);
    });
    field.addEventListener("change", () => set(field.value === "" ? recipe[control.name] : Number(field.value)));
    return {
      parts: [range, field], labels: id,
      show: (value) => {
        const at = (down(Math.min(Math.max(value, control.low), control.high)) - low) / width;
        range.value = String(Math.round(at * range.max));
        range.setAttribute("aria-valuetext", `${short(value)} ${control.unit === "1" ? "" : control.unit}`);
        if (Number(field.value) !== value || field.value === "") field.value = String(value);
      },
    };
  }

  function counts(control, set) {
    const id = `slide-${control.name}`, all = control.counts;
    const range = make("input", { type: "range", id, min: "0", max: String(all.length - 1), step: "1" });
    const field = make("input", { type: "number", id: `field-${control.name}`, step: "1",
      "aria-label": "triangles, number: 8 n² or 20 n²" });
    range.addEventListener("input", () => set(all[range.value]));
    field.addEventListener("change", () => set(Number(field.value)));
    return {
      parts: [range, field], labels: id,
      show: (value) => {
        const near = all.reduce((best, count, i) => Math.abs(count - value) < Math.abs(all[best] - value) ? i : best, 0);
        range.value = String(near);
        range.setAttribute("aria-valuetext", `${value} triangles`);
        field.value = String(value);
      },
    };
  }

  function vector(control, set) {
    const fields = ["x", "y", "z"].map((letter, i) => {
      const field = make("input", { type: "number", step: "any", id: `field-${control.name}-${letter}`,
        "aria-label": `${control.name.replaceAll("_", " ")} ${letter}` });
      field.addEventListener("change", () => {
        const value = [...shown()[control.name]];
        if (field.value !== "") value[i] = Number(field.value);
        set(value);
      });
      return field;
    });
    return { parts: fields, labels: fields[0].id, isWide: true,
      show: (value) => fields.forEach((field, i) => { field.value = String(value[i]); }) };
  }

  function choice(control, set) {
    const id = `choice-${control.name}`;
    const list = make("select", { id }, ...control.choices.map((word) => make("option", { value: word }, word)));
    list.addEventListener("change", () => set(list.value));
    return { parts: [list], labels: id, isWide: true, show: (value) => { list.value = value; } };
  }

  function flag(control, set) {
    const id = `flag-${control.name}`;
    const box = make("input", { type: "checkbox", id, role: "switch" });
    box.addEventListener("change", () => set(box.checked));
    return { parts: [box], labels: id, isWide: true, show: (value) => { box.checked = value; } };
  }

  function seed(control, set) {
    const id = "field-seed";
    const field = make("input", { type: "text", id, inputmode: "numeric", pattern: "[0-9]*", maxlength: "20" });
    const dice = make("button", { type: "button", id: "dice", title: "another stone of the same setting" }, "⚄ dice");
    field.addEventListener("change", () => set(field.value.trim()));
    dice.addEventListener("click", () => set(String(Math.floor(Math.random() * 2 ** 53))));
    return { parts: [field, dice], labels: id, isWide: true, show: (value) => { field.value = value; } };
  }

  const builders = { slider, counts, vector, choice, flag, seed };

  function build() {
    const groups = about.groups.map((group, i) => {
      const rows = group.controls.map((control) => {
        const built = builders[control.kind](control, (value) => change({ [control.name]: value }, control.name));
        controls[control.name] = built;
        const symbol = lithoform.symbol(control.symbol === control.name ? "" : control.symbol);
        const unit = control.unit && control.unit !== "1" ? ` [${control.unit}]` : "";
        const label = make("label", { for: built.labels, title: control.meaning },
          control.name.replaceAll("_", " "), " ", symbol, unit);
        return make("div", { class: `control ${built.isWide ? "wide" : ""} ${control.kind}` }, label, ...built.parts);
      });
      return make("details", i < 3 ? { open: true } : {}, make("summary", {}, group.name), ...rows);
    });
    $("studio-controls").replaceChildren(...groups);
    $("studio-controls").addEventListener("submit", (event) => event.preventDefault());
  }

  function actions() {
    const button = (id, text, title, act) => {
      const made = make("button", { type: "button", id, title }, text);
      made.addEventListener("click", act);
      return made;
    };
    const presets = make("select", { id: "preset", "aria-label": "preset" }, make("option", { value: "" }, "preset…"),
      ...about.presets.map((name) => make("option", { value: name }, name === "benchmark" ? name : `database ${name}`)));
    presets.addEventListener("change", async () => {
      const name = presets.value;
      presets.value = "";
      if (!name) return;
      const { seed, triangles } = shown();
      const found = await lithoform.ask("recipe", { preset: name, seed, triangles });
      if (found) change(found.recipe, null);
    });
    $("studio-actions").replaceChildren(presets,
      button("undo", "Undo", "Ctrl+Z", undo), button("redo", "Redo", "Ctrl+Shift+Z", redo));
    const kinds = [["stl", "Mesh (STL)"], ["json", "Its sidecar (JSON)"], ["toml", "Recipe (TOML)"]];
    const files = kinds.map(([kind, text]) =>
      button(`get-${kind}`, text, kind === "json" ? "how the mesh was made, with the checksums of the STL file" : "",
        () => download(kind)));
    const link = button("copy-link", "Copy link", "a link that opens this very stone", copyLink);
    $("studio-files").replaceChildren(...files, link);
    document.addEventListener("keydown", (event) => {
      const isText = /^(text|number)$/.test(event.target.type || "");
      if (lithoform.tab !== "studio" || isText || !(event.ctrlKey || event.metaKey)) return;
      if (event.key.toLowerCase() === "z") { event.preventDefault(); (event.shiftKey ? redo : undo)(); }
      if (event.key.toLowerCase() === "y") { event.preventDefault(); redo(); }
    });
  }

  // One of L >= W >= H moves the others where it must.
  function ordered(next, name) {
    const [length, width, height] = about.sizes;
    // A size that no stone has is refused as it is, and must not spoil the others.
    if (!(next[name] > 0)) return next;
    if (name === length) { next[width] = Math.min(next[width], next[length]); }
    if (name === height) { next[width] = Math.max(next[width], next[height]); }
    if (about.sizes.includes(name)) {
      next[length] = Math.max(next[length], next[width]);
      next[height] = Math.min(next[height], next[width]);
    }
    return next;
  }

  // What was refused is neither the base of the next change nor a step of the history.
  function dropRefused() {
    if (!isRefused || !drawn) return false;
    isRefused = false;
    changed = null;
    recipe = drawn;
    if (past.length && isSame(past[past.length - 1], drawn)) past.pop();
    return true;
  }

  function change(values, name) {
    const wasRefused = dropRefused();
    const next = ordered({ ...recipe, ...values }, name);
    if (isSame(next, recipe)) { show(); if (wasRefused) redraw(); return; }
    // A slider that is drawn along is one move.
    const now = performance.now();
    if (!(name && changed && changed.name === name && now - changed.at < ONE_MOVE)) past.push(recipe);
    changed = { name, at: now };
    future.length = 0;
    recipe = next;
    show();
    redraw();
  }

  function undo() {
    if (dropRefused()) { show(); redraw(); } else step(past, future);
  }
  function redo() { step(future, past); }
  function step(from, to) {
    if (!from.length) return;
    to.push(recipe);
    recipe = from.pop();
    changed = null;
    show();
    redraw();
  }

  function show() {
    for (const [name, control] of Object.entries(controls)) control.show(recipe[name]);
    $("undo").disabled = !past.length && !(isRefused && drawn);
    $("redo").disabled = !future.length;
  }

  function redraw(wait = WAIT) {
    if (timer) return;
    since = performance.now();
    timer = setTimeout(go, wait);
  }

  function go() {
    if (flight && performance.now() - flight < PATIENCE) { timer = setTimeout(go, 10); return; }
    timer = null;
    draw(since);
  }

  async function draw(asked) {
    const told = $("studio-told"), mine = flight = performance.now(), wanted = recipe;
    const stone = await lithoform.ask("stone", { recipe: wanted }, {
      channel: "studio", what: "Making the stone …",
      told: (text, isAnswer) => {
        told.textContent = text;
        told.classList.add("refused");
        if (isAnswer && recipe === wanted) { isRefused = true; show(); }
      },
    });
    if (flight === mine) flight = 0;
    if (!stone) return;
    drawn = wanted;
    if (recipe === wanted) isRefused = false;
    view.show(stone);
    lithoform.link = stone.told.link;
    lithoform.remember();
    const { seconds, triangles, notes, hash } = stone.told;
    told.classList.remove("refused");
    const server = 1e3 * (seconds.generate + seconds.measure), whole = performance.now() - asked;
    told.textContent = `${triangles.toLocaleString("en")} triangles, ${stone.told.descriptors.zingg_class}; ` +
      `made in ${server.toFixed(0)} ms, drawn in ${whole.toFixed(0)} ms${notes.map((note) => `; ${note}`).join("")}.`;
    Object.assign($("studio-view").dataset, { hash, server: server.toFixed(1), whole: whole.toFixed(1) });
    const places = stone.told.percentiles || {};
    const columns = about.population ? { percentile: (name) => name in places && places[name] !== null
      ? places[name].toFixed(0) : "" } : {};
    $("studio-numbers").replaceChildren(lithoform.numbers(stone.told.descriptors, columns),
      make("p", { class: "note" }, about.population ? `Percentiles are of ${about.population}.`
        : "Start the explorer with a database to see percentiles."));
    measured = stone.told;
  }

  // What was refused has no stone to keep.
  const shown = () => (isRefused && drawn ? drawn : recipe);

  async function download(kind) {
    const file = await lithoform.ask("file", { recipe: shown(), kind }, { channel: "file", what: "Writing the file …" });
    if (!file) return;
    const link = make("a", { href: URL.createObjectURL(file.blob), download: file.name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  async function copyLink() {
    const link = `${location.origin}/?tab=studio${lithoform.link ? `&${lithoform.link}` : ""}`;
    try {
      await navigator.clipboard.writeText(link);
      lithoform.say("Link copied.");
    } catch {
      lithoform.say("The browser copies nothing here; take the link from its address line.");
    }
  }

  // A recipe from elsewhere, such as another tab's stone.
  lithoform.take = (values) => { change(values, null); lithoform.open("studio"); };

  lithoform.startStudio = async () => {
    const link = location.search;
    about = await lithoform.ask("start", {});
    if (!about) return;
    view = lithoform.view($("studio-view"), "the stone");
    build();
    actions();
    recipe = about.benchmark;
    const found = link.length > 1 ? await lithoform.ask("recipe", { link }, {
      told: (text) => lithoform.notice(`This link was refused: ${text} The benchmark is shown.`) }) : null;
    if (found) {
      [recipe, lithoform.link] = [found.recipe, found.link];
      lithoform.remember();
    }
    show();
    lithoform.studioIsReady = true;
    if (lithoform.tab === "studio") redraw(0);
  };
  // The first stone is made when somebody looks.
  lithoform.openedStudio = () => { if (lithoform.studioIsReady && !measured) redraw(0); };
})();
