"use strict";
(() => {
  const root = document.documentElement;
  const prefersDark = window.matchMedia("(prefers-color-scheme: dark)");
  let chosen = "auto";
  const theme = (printing = false) => {
    const dark = !printing && (chosen === "auto" ? prefersDark.matches : chosen === "dark");
    root.dataset.theme = dark ? "dark" : "light";
  };
  const button = document.getElementById("theme");
  const names = { auto: "Theme: as the system", light: "Theme: light", dark: "Theme: dark" };
  button.hidden = false;
  button.addEventListener("click", () => {
    chosen = { auto: "light", light: "dark", dark: "auto" }[chosen];
    button.textContent = names[chosen];
    theme();
  });
  prefersDark.addEventListener("change", () => theme());

  // Maps: one at a time on a screen, all of them on paper, where none can be chosen.
  const maps = [...document.querySelectorAll(".mapbox")];
  const picker = document.getElementById("map-picker");
  const showMap = () => maps.forEach((map) => { map.hidden = map.id !== picker.value; });
  if (picker) {
    picker.closest(".tools").hidden = false;
    picker.addEventListener("change", showMap);
    showMap();
  }
  window.addEventListener("beforeprint", () => { maps.forEach((map) => { map.hidden = false; }); theme(true); });
  window.addEventListener("afterprint", () => { if (picker) showMap(); theme(); });

  // Every run. Columns are packed: one value for all runs, a letter for each truth value, numbered words, or as they are.
  const source = JSON.parse(document.getElementById("data-runs").textContent);
  const columns = new Map(source.columns.map((column) => [column.name, column]));
  const valueOf = (column, row) => {
    if ("shared" in column) return column.shared;
    if (column.flags) return { t: true, f: false }[column.flags[row]] ?? null;
    return column.codes ? column.words[column.codes[row]] : column.numbers[row];
  };

  // The language of `rebar runs --where` (bench/reporting/_conditions.py); null is neither true nor false.
  const TOKEN = /\s*(?:(==|!=|<=|>=|<|>|\(|\))|("[^"]*"|'[^']*')|(-?\d+(?:\.\d+)?(?:[eE]-?\d+)?)(?![\w.-])|(`[^`]+`(?:\.\w+)*|[\p{L}\p{N}_][\p{L}\p{N}_.-]*))/uy;
  const KINDS = ["sign", "text", "number", "word"];
  const COMPARE = {
    "==": (a, b) => a === b, "!=": (a, b) => a !== b, "<": (a, b) => a < b, "<=": (a, b) => a <= b, ">": (a, b) => a > b, ">=": (a, b) => a >= b,
  };
  const condition = (text) => {
    const tokens = [];
    TOKEN.lastIndex = 0;
    for (let place = 0; text.slice(place).trim(); place = TOKEN.lastIndex) {
      TOKEN.lastIndex = place;
      const match = TOKEN.exec(text);
      if (!match) throw new Error(`cannot be read from ${text.slice(place).trim()} on`);
      const kind = match.slice(1).findIndex((part) => part !== undefined);
      tokens.push([KINDS[kind], match[kind + 1]]);
    }
    tokens.push(["end", "its end"]);
    let next = 0;
    let depth = 0;
    const take = (token) => {
      const [kind, here] = tokens[next];
      if ((kind !== "word" && kind !== "sign") || here !== token) return false;
      next += 1;
      return true;
    };
    const column = (word) => {
      const longer = [...columns.keys()].filter((name) => name.startsWith(word + "_"));
      const name = columns.has(word) ? word : longer.length === 1 ? longer[0] : null;
      if (name === null) throw new Error(`has the word ${word}, which is no column${longer.length ? `: did you mean ${longer.join(" or ")}?` : "; text stands in quotes"}`);
      return columns.get(name);
    };
    const value = () => {
      const [kind, token] = tokens[next];
      next = Math.min(next + 1, tokens.length - 1);
      if (kind === "number") return [kind, () => Number(token)];
      if (kind === "text") return [kind, () => token.slice(1, -1)];
      if (kind !== "word") throw new Error(`has ${token} where a value should be`);
      if (token === "true" || token === "false") return ["truth value", () => token === "true"];
      if (token === "none") return ["none", () => null];
      const named = column(token.replaceAll("`", ""));
      return [named.kind, (row) => valueOf(named, row)];
    };
    const comparison = () => {
      const [leftKind, left] = value();
      const [, sign] = tokens[next];
      const compare = Object.hasOwn(COMPARE, sign) ? COMPARE[sign] : null;
      if (!compare) throw new Error(`has ${sign} where a comparison should be, such as == or >=`);
      next += 1;
      const [rightKind, right] = value();
      if (leftKind === "none" || rightKind === "none") {
        if (sign !== "==" && sign !== "!=") throw new Error(`compares none by ${sign}`);
        return (row) => compare(left(row) ?? right(row), null);
      }
      if (leftKind !== rightKind) throw new Error(`compares a ${leftKind} with a ${rightKind}`);
      return (row) => {
        const [a, b] = [left(row), right(row)];
        return a === null || b === null ? null : compare(a, b);
      };
    };
    const nested = (part) => {
      if (depth === 40) throw new Error("is nested deeper than 40");
      depth += 1;
      const inner = part();
      depth -= 1;
      return inner;
    };
    const negation = () => {
      if (take("not")) {
        const inner = nested(negation);
        return (row) => { const truth = inner(row); return truth === null ? null : !truth; };
      }
      if (!take("(")) return comparison();
      const inner = nested(either);
      if (!take(")")) throw new Error(`lacks a ) before ${tokens[next][1]}`);
      return inner;
    };
    const joined = (word, part, decides) => {
      let left = part();
      while (take(word)) {
        const [first, second] = [left, part()];
        left = (row) => {
          const [a, b] = [first(row), second(row)];
          return a === decides || b === decides ? decides : a === null || b === null ? null : !decides;
        };
      }
      return left;
    };
    const both = () => joined("and", negation, false);
    const either = () => joined("or", both, true);
    const whole = either();
    if (tokens[next][0] !== "end") throw new Error(`has ${tokens[next][1]} where it should end`);
    return whole;
  };

  const view = document.getElementById("runs-view");
  if (view) {
    const ROW_PX = 34;
    const heads = [...view.querySelectorAll("th")];
    const shown = heads.map((head) => columns.get(head.dataset.column));
    const body = view.querySelector("tbody");
    const input = document.getElementById("where");
    const says = document.getElementById("where-says");
    const detail = document.getElementById("run-detail");
    const everyRow = Array.from({ length: source.rows }, (_, row) => row);
    const listed = body.rows.length;
    let rows = everyRow;
    let order = null;
    const text = (value) => value === null || value === "" ? "–" : value === true ? "✓" : value === false ? "✗"
      : typeof value === "number" && !Number.isInteger(value) ? value.toFixed(1) : String(value);
    const element = (tag, content = "", ...children) => {
      const made = document.createElement(tag);
      made.textContent = content;
      made.append(...children);
      return made;
    };
    const line = (row) => {
      const made = element("tr");
      made.dataset.row = row;
      shown.forEach((column, place) => {
        const value = valueOf(column, row);
        const cell = element("td", place ? text(value) : "");
        if (!place) cell.append(element("button", text(value)));
        if (value === false) cell.className = "bad";
        cell.title = text(value);
        made.append(cell);
      });
      return made;
    };
    // Only the rows in view are in the document; two empty rows hold the place of the others.
    const draw = (printing = false) => {
      const first = printing ? 0 : Math.max(0, Math.floor(view.scrollTop / ROW_PX) - 10);
      const last = Math.min(rows.length, printing ? listed : first + Math.ceil((view.clientHeight || 600) / ROW_PX) + 30);
      // A new row in place of the one that has the focus takes it over, or a keyboard would lose its place.
      const focused = body.contains(document.activeElement) ? document.activeElement.closest("tr").dataset.row : null;
      const space = (count) => { const made = element("tr"); made.className = "space"; made.style.height = `${count * ROW_PX}px`; return made; };
      body.replaceChildren(space(first), ...rows.slice(first, last).map(line), space(rows.length - last));
      if (focused !== null) body.querySelector(`tr[data-row="${focused}"] button`)?.focus({ preventScroll: true });
    };
    const choose = () => {
      try {
        const test = input.value.trim() ? condition(input.value) : () => true;
        rows = everyRow.filter((row) => test(row) === true);
        says.textContent = `${rows.length} of ${source.rows} run${source.rows === 1 ? "" : "s"}`;
        says.classList.remove("bad");
      } catch (error) {
        says.textContent = error.message;
        says.classList.add("bad");
        return;
      }
      if (order) rows.sort(order);
      view.scrollTop = 0;
      draw();
    };
    const open = (row) => {
      const of = (name) => valueOf(columns.get(name), row);
      const failed = source.columns.filter((column) => column.name.endsWith(".passed") && valueOf(column, row) === false);
      const path = of("recording");
      const facts = element("dl");
      facts.className = "facts";
      const fact = (name, value) => { if (value) facts.append(element("dt", name), element("dd", value)); };
      fact("Ended", `${of("outcome")}: ${of("reason")}`);
      fact("Remark", of("mark"));
      fact("Not passed", failed.map((column) => column.name.replace(/\.passed$/, "")).join(", ") || "nothing");
      fact("Recording", path || "is not here");
      fact("SHA-256", of("sha256"));
      fact("Seed", of("seed"));
      for (const [observable, stages] of source.stages[of("run")] ?? []) fact(observable, stages);
      fact("Why", path ? `rebar explain DIR/${path.replace(/\/[^/]*$/, "")}` : "");
      detail.replaceChildren(element("h3", of("run")), facts);
      const box = source.maps[of("run")];
      if (box) {
        const link = element("a", "Its map, reports and decisions");
        link.href = `#${box}`;
        link.addEventListener("click", () => { picker.value = box; showMap(); });
        detail.append(element("p", "", link));
      }
    };
    document.getElementById("where-form").hidden = false;
    document.getElementById("where-form").addEventListener("submit", (event) => event.preventDefault());
    input.addEventListener("input", choose);
    view.addEventListener("scroll", () => draw());
    window.addEventListener("resize", () => draw());
    window.addEventListener("beforeprint", () => draw(true));
    window.addEventListener("afterprint", () => draw());
    body.addEventListener("click", (event) => {
      const row = event.target.closest("tr[data-row]");
      if (row) open(Number(row.dataset.row));
    });
    heads.forEach((head, place) => {
      const control = element("button", head.textContent);
      control.type = "button";
      control.addEventListener("click", () => {
        const up = head.getAttribute("aria-sort") !== "ascending";
        heads.forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        order = (a, b) => {
          const [x, y] = [valueOf(shown[place], a), valueOf(shown[place], b)];
          return x === y ? 0 : x === null ? 1 : y === null ? -1 : (x < y ? -1 : 1) * (up ? 1 : -1);
        };
        choose();
      });
      head.replaceChildren(control);
    });
    view.classList.add("live");
    choose();
  }

  // The hierarchy: rows below a folded row are hidden, whatever their own state.
  const fold = (row) => row.querySelector("button.fold");
  const refresh = (table) => {
    let hiddenBelow = Infinity;
    for (const row of table.tBodies[0].rows) {
      const depth = Number(row.dataset.depth);
      if (depth <= hiddenBelow) hiddenBelow = Infinity;
      row.hidden = hiddenBelow !== Infinity;
      const control = fold(row);
      if (!row.hidden && control && control.getAttribute("aria-expanded") === "false") hiddenBelow = depth;
    }
  };
  const all = (table, below) => {
    for (const row of table.tBodies[0].rows) {
      if (fold(row)) fold(row).setAttribute("aria-expanded", String(Number(row.dataset.depth) < below));
    }
    refresh(table);
  };
  for (const table of document.querySelectorAll("table.tree")) {
    table.addEventListener("click", (event) => {
      const control = event.target.closest("button.fold");
      if (!control) return;
      control.setAttribute("aria-expanded", String(control.getAttribute("aria-expanded") === "false"));
      refresh(table);
    });
    table.querySelectorAll("button.fold").forEach((control) => { control.hidden = false; });
    all(table, 1);
  }
  for (const box of document.querySelectorAll(".treebox")) {
    const tools = box.querySelector(".tools");
    tools.hidden = false;
    tools.addEventListener("click", (event) => {
      if (!event.target.dataset.below) return;
      const below = Number(event.target.dataset.below);
      box.querySelectorAll("details.branch").forEach((branch) => { branch.open = below > 0; });
      box.querySelectorAll("table.tree").forEach((table) => all(table, Math.max(1, below)));
    });
  }

  // What scrolls sideways can be reached and scrolled by keyboard.
  const reach = () => document.querySelectorAll(".scroll").forEach((box) => {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0; else box.removeAttribute("tabindex");
  });
  window.addEventListener("resize", reach);
  reach();

  theme();
})();
