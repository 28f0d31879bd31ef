"use strict";
(() => {
  const data = JSON.parse(document.getElementById("document").textContent);
  const at = (id) => document.getElementById(id);
  const make = (kind, text = "", name = "") => {
    const element = document.createElement(kind);
    if (text) element.textContent = text; // never markup: titles come from documents
    if (name) element.className = name;
    return element;
  };
  const nodes = new Map(data.nodes.map((node) => [node.id, { ...node, parents: [] }]));
  for (const node of nodes.values()) for (const child of node.children) nodes.get(child).parents.push(node.id);
  const roots = [...nodes.values()].filter((node) => !node.parents.length).map((node) => node.id);
  const levelOf = (node) => data.levels.indexOf(data.levels.find((_, place) => depthName[place] === node.level));
  const depthName = [];
  for (const node of nodes.values()) if (!depthName.includes(node.level)) depthName.push(node.level);
  nodes.forEach((node) => { node.depth = levelOf(node); });

  const ROW = 58, BOX = 50, WIDTH = 300, GAP = 60, TOP = 40, EDGE = 18, SMALL = 60;
  const open = new Set();
  let chosen = null;
  let hits = [];
  let agent = data.agent;
  let by = data.by;
  let place = new Map();

  const column = (depth) => EDGE + depth * (WIDTH + GAP);
  const shownOf = (id, name = agent) => (data.shown[name] || {})[id];
  const showDownTo = (depth) => {
    open.clear();
    nodes.forEach((node) => { if (node.depth < depth) open.add(node.id); });
  };

  // The layout of the drawing: beneath the first parent that names the node, beside the middle of its children.
  const layOut = () => {
    place = new Map();
    const beneath = new Map();
    let end = 0;
    const put = (id) => {
      const node = nodes.get(id);
      const children = open.has(id) ? node.children.filter((child) => !beneath.has(child)) : [];
      children.forEach((child) => beneath.set(child, id));
      const rows = children.map(put);
      const row = rows.length ? (rows[0] + rows[rows.length - 1]) / 2 : end++;
      place.set(id, { row, first: beneath.get(id) });
      if (rows.length) end += node.depth === 0 ? 0.5 : node.depth === 1 ? 0.2 : 0;
      return row;
    };
    roots.forEach(put);
    return end;
  };

  const board = at("board");
  const tree = at("tree");
  const items = new Map();
  for (const node of nodes.values()) {
    const item = make("div", "", "node" + (node.studied ? " studied" : ""));
    item.id = "node-" + node.id;
    item.dataset.id = node.id;
    item.setAttribute("role", "treeitem");
    item.setAttribute("aria-level", String(node.depth + 1));
    item.tabIndex = -1;
    const swatch = make("span", "", "swatch");
    const text = make("span", "", "text");
    const more = [node.id, ...(node.studied ? ["under study"] : []), ...(node.parents.length > 1 ? [node.parents.length + " parents"] : [])];
    text.append(make("span", node.title, "t"), make("span", more.join(" · "), "i"));
    item.append(swatch, text);
    if (node.children.length) item.append(make("span", "", "fold"));
    item.title = node.title;
    items.set(node.id, item);
    tree.append(item);
  }

  const kin = (id, step) => {
    const reached = new Set();
    const walk = (current) => nodes.get(current)[step].forEach((next) => { if (!reached.has(next)) { reached.add(next); walk(next); } });
    walk(id);
    return reached;
  };

  // The visible nodes in the order of the document, the most general first.
  const inOrder = () => [...items.keys()].filter((id) => place.has(id));

  const path = (from, to, name) => {
    const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
    const a = place.get(from), b = place.get(to);
    const x0 = column(nodes.get(from).depth) + WIDTH, x1 = column(nodes.get(to).depth);
    const y0 = TOP + a.row * ROW + BOX / 2, y1 = TOP + b.row * ROW + BOX / 2, middle = (x0 + x1) / 2;
    line.setAttribute("d", `M${x0} ${y0}C${middle} ${y0} ${middle} ${y1} ${x1} ${y1}`);
    if (name) line.setAttribute("class", name);
    return line;
  };

  const draw = () => {
    const end = layOut();
    const up = chosen ? kin(chosen, "parents") : new Set(), down = chosen ? kin(chosen, "children") : new Set();
    const lit = (parent, child) => chosen && (((up.has(parent)) && (up.has(child) || child === chosen)) || ((down.has(child)) && (down.has(parent) || parent === chosen)));
    const matches = new Set(hits);
    for (const [id, item] of items) {
      const node = nodes.get(id), where = place.get(id);
      item.hidden = !where;
      if (!where) continue;
      item.style.left = column(node.depth) + "px";
      item.style.top = TOP + where.row * ROW + "px";
      item.style.width = WIDTH + "px";
      if (node.children.length) {
        item.setAttribute("aria-expanded", String(open.has(id)));
        item.querySelector(".fold").textContent = (open.has(id) ? "− " : "+ ") + node.children.length;
      }
      item.setAttribute("aria-selected", String(id === chosen));
      item.classList.toggle("hit", matches.has(id));
      item.classList.toggle("near", up.has(id) || down.has(id));
      item.classList.toggle("dim", Boolean(at("find").value.trim()) && !matches.has(id) && id !== chosen);
      const swatch = item.querySelector(".swatch");
      swatch.hidden = !agent;
      if (agent) {
        const [step, text] = (shownOf(id) || {})[by] || ["absent", "–"];
        swatch.className = "swatch " + (step.length === 1 ? "s" + step : step);
        swatch.textContent = text;
        const name = data.measured.find(([key]) => key === by)[1];
        item.setAttribute("aria-label", `${node.id} ${node.title}. ${name}: ${data.states[step] || text}`);
      } else item.setAttribute("aria-label", `${node.id} ${node.title}`);
    }
    const edges = at("edges");
    const behind = [], before = [];
    for (const [id, { first }] of place) if (first) (lit(first, id) ? before : behind).push(path(first, id, lit(first, id) ? "lit" : ""));
    // Edges to further parents are many and long: they are drawn only for the chosen node and its kin.
    for (const [id, { first }] of place) {
      for (const parent of nodes.get(id).parents) if (parent !== first && place.has(parent) && lit(parent, id)) before.push(path(parent, id, "also"));
    }
    edges.replaceChildren(...behind, ...before);
    const deepest = Math.max(...[...place.keys()].map((id) => nodes.get(id).depth));
    const width = column(deepest) + WIDTH + EDGE, height = TOP + end * ROW + 20;
    board.style.width = width + "px";
    board.style.height = height + "px";
    edges.setAttribute("width", width);
    edges.setAttribute("height", height);
    at("canvas").classList.toggle("lighting", Boolean(chosen));
    at("heads").replaceChildren(...data.levels.slice(0, deepest + 1).map((name, depth) => {
      const head = make("span", name);
      head.style.left = column(depth) + "px";
      return head;
    }));
    const stop = chosen && place.has(chosen) ? chosen : inOrder()[0];
    items.forEach((item, id) => { item.tabIndex = id === stop ? 0 : -1; });
    const downTo = data.levels.findIndex((_, depth) => [...nodes.values()].every((node) => !node.children.length || open.has(node.id) === node.depth < depth));
    [...at("levels").children].forEach((button, depth) => button.setAttribute("aria-pressed", String(depth === downTo)));
  };

  const reveal = (id) => {
    for (const parent of nodes.get(id).parents.slice(0, 1)) { open.add(parent); reveal(parent); }
  };
  const choose = (id, focus) => {
    chosen = id;
    if (id && !place.has(id)) reveal(id);
    draw();
    describe();
    if (!id) return;
    items.get(id).scrollIntoView({ block: "nearest", inline: "nearest" });
    if (focus) items.get(id).focus({ preventScroll: true });
  };
  const toggle = (id) => {
    if (!nodes.get(id).children.length) return;
    if (open.has(id)) open.delete(id); else open.add(id);
    draw();
  };

  const links = (title, ids) => {
    if (!ids.length) return [];
    const list = make("ul");
    for (const id of ids) {
      const row = make("li"), button = make("button");
      button.type = "button";
      button.append(make("span", id, "i"), make("span", nodes.get(id).title));
      button.addEventListener("click", () => choose(id, true));
      row.append(button);
      list.append(row);
    }
    return [make("h3", title), list];
  };
  const table = (factor) => {
    const wide = make("div", "", "wide"), grid = make("table");
    for (const [name, cells] of [[factor.name, factor.values], ["rated", factor.ratings]]) {
      const row = make("tr"), head = make("th", name);
      head.scope = "row";
      row.append(head, ...cells.map((cell) => make("td", cell)));
      grid.append(row);
    }
    wide.append(grid);
    return [wide, make("p", `${factor.interpolation}. ${factor.reason}`, "small soft")];
  };
  const describe = () => {
    const side = at("details");
    if (!chosen) {
      side.replaceChildren(make("p", "Choose a node to see what it asks, how it is measured, what makes it hard" + (agent ? ", and what the campaign showed of it." : "."), "soft"));
      return;
    }
    const node = nodes.get(chosen);
    const facts = make("dl");
    node.facts.forEach(([name, text]) => facts.append(make("dt", name), make("dd", text)));
    const parts = [make("p", `${node.level} ${node.id}${node.studied ? " · under study" : ""}`, "soft small"), make("h2", node.title), make("p", node.asks)];
    if (agent) {
      for (const name of [agent, ...data.agents.filter((other) => other !== agent)]) {
        const lines = make("div", "", "sentences");
        for (const line of (shownOf(chosen, name) || { sentences: ["It is not in this campaign."] }).sentences) lines.append(make("p", line));
        parts.push(make("h3", name), lines);
      }
    }
    parts.push(make("h3", "What the document says"), facts);
    if (node.tables.length) parts.push(make("h3", "Key factors; the least rating is the difficulty"), ...node.tables.flatMap(table));
    parts.push(...links(node.parents.length > 1 ? "Its parents" : "Its parent", node.parents), ...links("Its children", node.children));
    side.replaceChildren(...parts);
    side.scrollTop = 0;
  };

  const neighbour = (id, step) => {
    const depth = nodes.get(id).depth;
    const same = [...place.keys()].filter((other) => nodes.get(other).depth === depth).sort((a, b) => place.get(a).row - place.get(b).row);
    return same[same.indexOf(id) + step];
  };
  tree.addEventListener("click", (event) => {
    const item = event.target.closest(".node");
    if (!item) return;
    if (event.target.closest(".fold")) toggle(item.dataset.id);
    choose(item.dataset.id, true);
  });
  tree.addEventListener("keydown", (event) => {
    const id = event.target.dataset.id;
    if (!id || event.ctrlKey || event.metaKey || event.altKey) return;
    const node = nodes.get(id);
    const ends = inOrder();
    const go = {
      ArrowDown: () => neighbour(id, 1), ArrowUp: () => neighbour(id, -1), Home: () => ends[0], End: () => ends[ends.length - 1],
      ArrowLeft: () => { if (open.has(id)) { toggle(id); return id; } return place.get(id).first; },
      ArrowRight: () => {
        if (node.children.length && !open.has(id)) { toggle(id); return id; }
        return node.children.find((child) => place.get(child).first === id) || node.children[0];
      },
      Enter: () => { toggle(id); return id; }, " ": () => { toggle(id); return id; },
    }[event.key];
    if (!go) return;
    event.preventDefault();
    const next = go();
    if (next) choose(next, true);
  });

  const words = new Map([...nodes.values()].map((node) => [node.id, [node.id, node.title, node.asks, ...node.facts.map((fact) => fact[1]), ...node.tables.map((factor) => factor.name)].join(" ").toLowerCase()]));
  const find = at("find");
  const search = () => {
    const terms = find.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    hits = terms.length ? [...nodes.keys()].filter((id) => terms.every((word) => words.get(id).includes(word))) : [];
    if (hits.length <= SMALL) hits.forEach(reveal);
    at("found").textContent = terms.length ? `${hits.length} of ${nodes.size}` : "";
    draw();
    if (hits.length) items.get(hits[0]).scrollIntoView({ block: "nearest", inline: "nearest" });
  };
  find.addEventListener("input", search);
  find.addEventListener("keydown", (event) => {
    if (event.key === "Escape") { find.value = ""; search(); }
    if (event.key !== "Enter" || !hits.length) return;
    const now = hits.indexOf(chosen);
    choose(hits[(now + (event.shiftKey ? hits.length - 1 : 1)) % hits.length], false);
  });
  document.addEventListener("keydown", (event) => {
    if (event.key === "/" && !/^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName)) { event.preventDefault(); find.focus(); }
    if (event.key === "Escape" && event.target !== find) choose(null);
  });

  data.levels.forEach((name, depth) => {
    const button = make("button", name);
    button.type = "button";
    button.addEventListener("click", () => { showDownTo(depth); draw(); });
    at("levels").append(button);
  });
  const picker = (box, options, now, changed) => {
    if (!box) return;
    options.forEach(([value, name]) => { const option = make("option", name); option.value = value; box.append(option); });
    box.value = now;
    box.addEventListener("change", () => { changed(box.value); draw(); describe(); });
  };
  picker(at("agent"), data.agents.map((name) => [name, name]), agent, (value) => { agent = value; });
  picker(at("by"), data.measured, by, (value) => { by = value; });

  const prefersDark = window.matchMedia("(prefers-color-scheme: dark)");
  let theme = "auto";
  const dress = () => { document.documentElement.dataset.theme = (theme === "auto" ? prefersDark.matches : theme === "dark") ? "dark" : "light"; };
  const names = { auto: "Theme: as the system", light: "Theme: light", dark: "Theme: dark" };
  at("theme").addEventListener("click", () => {
    theme = { auto: "light", light: "dark", dark: "auto" }[theme];
    at("theme").textContent = names[theme];
    dress();
  });
  prefersDark.addEventListener("change", dress);
  const about = at("about-button");
  if (about) {
    about.hidden = false;
    at("about").hidden = true;
    about.addEventListener("click", () => { at("about").hidden = !at("about").hidden; about.setAttribute("aria-expanded", String(!at("about").hidden)); });
  }
  ["tools", "canvas", "details"].forEach((id) => { at(id).hidden = false; });
  dress();
  showDownTo(nodes.size <= SMALL ? data.levels.length - 1 : 1);
  // A link may name a node: graph.html#KA-18.
  const named = decodeURIComponent(location.hash.slice(1));
  if (nodes.has(named)) { draw(); choose(named, false); } else { draw(); describe(); }
})();
