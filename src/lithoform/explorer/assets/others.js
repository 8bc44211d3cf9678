// Stones beside the design space and the populations, and contact sheets.
"use strict";
window.lithoform = window.lithoform || {};

(() => {
  const $ = (id) => document.getElementById(id), make = (...all) => lithoform.make(...all);
  const FOUR = ["roundness", "boxiness", "solidity", "true_sphericity"];
  const AT_ONCE = 2, SIZE = 132;
  const views = {};
  let point = null, later = null, sheet = { source: null, shape: "all", start: 0, total: 0, page: 24 };

  // Made when it is first needed: the tabs come when they are opened.
  function viewOf(id, label) {
    if (!views[id] || !views[id].canvas.isConnected) views[id] = lithoform.view($(id), label);
    return views[id];
  }

  function button(text, act) {
    const made = make("button", { type: "button" }, text);
    made.addEventListener("click", act);
    return made;
  }

  lithoform.showPoint = async (index, seed = 0) => {
    const told = $("space-told");
    const found = await lithoform.ask("point", { index, seed }, {
      channel: "space", what: `Making a stone of design ${index} …`, told: (text) => { told.textContent = text; } });
    if (!found) return;
    viewOf("space-view", "the stone of a design").show(found);
    point = found.told;
    const values = point.descriptors, own = point.values;
    told.textContent = `Design ${index}, seed ${seed}: ${point.triangles.toLocaleString("en")} triangles.`;
    $("space-view").dataset.hash = point.hash;
    const place = $("space-numbers");
    const fill = (predicted) => {
      const at = (name) => FOUR.indexOf(name);
      const columns = predicted
        ? { predicted: (name) => `${predicted.mean[at(name)].toFixed(3)} ± ${predicted.scatter[at(name)].toFixed(3)}` }
        : { library: (name) => own[name].toFixed(3) };
      const centre = predicted ? (name) => predicted.mean[at(name)] : (name) => own[name];
      columns.off = (name) => lithoform.fixed(values[name] - centre(name));
      const table = lithoform.numbers(values, columns, FOUR, true);
      table.querySelector("tr").children[1].textContent = "achieved";
      place.replaceChildren(table, make("p", { class: "note" }, predicted
        ? "Predicted: mean over seeds ± scatter from seed to seed." : "Library: the one stone that was measured there."),
      make("div", { class: "row" },
        button("Another seed", () => lithoform.showPoint(index, Math.floor(Math.random() * 2 ** 32))),
        button("Open in the studio", () => lithoform.take(point.recipe))));
    };
    fill(null);
    const predicted = await lithoform.ask("predict", { index }, { channel: "space", turn: lithoform.turnOf("space"),
      what: "Fitting the prediction to the library, once …", told: (text) => { told.textContent = text; } });
    if (predicted) fill(predicted);
  };

  lithoform.showSheet = async (source, shape, start) => {
    if (lithoform.tab !== "population") { later = [source, shape, start]; return; }
    later = null;
    if (!$("sheet-told")) { requestAnimationFrame(() => lithoform.showSheet(source, shape, start)); return; }
    const told = $("sheet-told"), place = $("sheet");
    const turn = lithoform.newTurn("sheet");
    const list = await lithoform.ask("sheet", { source, class: shape, start }, { channel: "sheet", turn,
      what: "Reading the database …", told: (text) => { told.textContent = text; } });
    if (!list) return;
    sheet = { ...sheet, source, shape, start: list.start, total: list.total };
    const cells = list.stones.map((row) => {
      const canvas = make("canvas", { width: SIZE, height: SIZE, "aria-hidden": "true" });
      const caption = row.roundness === null ? "" : ` R ${row.roundness.toFixed(2)}`;
      const cell = make("button", { type: "button", class: "cell",
        title: FOUR.filter((name) => row[name] !== null).map((name) => `${name.replaceAll("_", " ")} ` +
          row[name].toFixed(3)).join("\n") }, canvas, make("span", {}, `${row.number}${caption}`));
      cell.addEventListener("click", () => showStone(source, row.number));
      return { row, canvas, cell };
    });
    place.replaceChildren(...cells.map(({ cell }) => cell));
    $("sheet-back").disabled = list.start === 0;
    $("sheet-on").disabled = list.start + cells.length >= list.total;
    $("sheet-cancel").disabled = !cells.length;
    const last = list.start + cells.length;
    const range = cells.length ? `stones ${list.start + 1} to ${last} of ${list.total}` : "no stones";
    let done = 0, failed = "";
    const waiting = [...cells];
    const work = async () => {
      while (waiting.length) {
        const { row, canvas, cell } = waiting.shift();
        const found = await lithoform.ask("particle", { source, number: row.number, small: true },
          { channel: "sheet", turn, told: (text) => {
            failed = cell.title = text;
            cell.classList.add("failed");
          } });
        if (!lithoform.isTurn("sheet", turn)) return;
        if (found) lithoform.thumbnail(found, canvas);
        done += 1;
        told.textContent = done < cells.length ? `Drawing ${range}: ${done} of ${cells.length} …`
          : `${source}, ${range}.${failed ? ` ${failed}` : ""}`;
      }
    };
    told.textContent = cells.length ? `Drawing ${range} …` : `${source}, ${range}.`;
    await Promise.all(Array.from({ length: AT_ONCE }, work));
    if (lithoform.isTurn("sheet", turn)) $("sheet-cancel").disabled = true;
  };

  async function showStone(source, number) {
    const told = $("stone-told");
    const found = await lithoform.ask("particle", { source, number }, { channel: "stone",
      what: `Fetching stone ${number} …`, told: (text) => { told.textContent = text; } });
    if (!found) return;
    viewOf("stone-view", "a stone of the population").show(found);
    $("stone-view").dataset.hash = found.told.hash;
    told.textContent = `${source}, stone ${number}${found.told.class ? `, ${found.told.class}` : ""}: ` +
      `${found.told.triangles.toLocaleString("en")} triangles.`;
    const more = found.told.recipe ? [make("div", { class: "row" },
      button("Open in the studio", () => lithoform.take(found.told.recipe)))] : [];
    $("stone-numbers").replaceChildren(lithoform.numbers(found.told.descriptors), ...more);
  }

  // The first sheet is drawn when somebody looks.
  lithoform.openedPopulation = () => { if (later) lithoform.showSheet(...later); };

  lithoform.startOthers = () => {
    const acts = {
      "sheet-back": () => lithoform.showSheet(sheet.source, sheet.shape, sheet.start - sheet.page),
      "sheet-on": () => lithoform.showSheet(sheet.source, sheet.shape, sheet.start + sheet.page),
      "sheet-cancel": () => {
        lithoform.cancel("sheet");
        $("sheet-cancel").disabled = true;
        $("sheet-told").textContent = "Cancelled.";
      },
    };
    document.addEventListener("click", (event) => {
      const chosen = event.target.closest("[data-point]");
      if (chosen) lithoform.showPoint(Number(chosen.dataset.point));
      if (acts[event.target.id]) acts[event.target.id]();
    });
  };
})();
