"use strict";
(() => {
  const root = document.documentElement;
  const prefersDark = window.matchMedia("(prefers-color-scheme: dark)");
  let chosen = "auto";
  let printing = false;
  const PAPER_PX = 1000;
  const PANEL_ON_PAPER_PX = 480;
  // The second column of .beside is 25rem wide (400 px), on paper too.
  const BESIDE_ON_PAPER_PX = 390;

  // Colours in the figures are CSS variables, so that one figure serves light, dark and print.
  const resolve = (value, style) => {
    if (typeof value === "string" && value.startsWith("var(")) return style.getPropertyValue(value.slice(4, -1)).trim();
    if (Array.isArray(value)) return value.map((item) => resolve(item, style));
    if (value && typeof value === "object") {
      return Object.fromEntries(Object.entries(value).map(([name, entry]) => [name, resolve(entry, style)]));
    }
    return value;
  };
  const draw = (box) => {
    const source = JSON.parse(document.getElementById("data-" + box.id).textContent);
    const figure = resolve(source, getComputedStyle(root));
    const interactive = box.classList.contains("map") && !printing;
    // The width of a page on paper, as @page in the style sets it; a figure as wide as the window would run over its edge.
    if (printing) {
      figure.layout.width = box.closest(".beside") ? BESIDE_ON_PAPER_PX : box.closest(".panel") ? PANEL_ON_PAPER_PX : PAPER_PX;
    }
    return Plotly.react(box, figure.data, figure.layout, {
      responsive: !printing, displaylogo: false, displayModeBar: interactive, scrollZoom: false, staticPlot: false,
      modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
      toImageButtonOptions: { format: "svg", filename: box.id },
    }).then(() => { box.dataset.drawn = "yes"; });
  };
  const boxes = [...document.querySelectorAll(".figure")];
  const visible = (box) => box.offsetParent !== null;
  const redraw = () => boxes.filter((box) => box.dataset.drawn).forEach(draw);
  const theme = () => {
    const dark = !printing && (chosen === "auto" ? prefersDark.matches : chosen === "dark");
    root.dataset.theme = dark ? "dark" : "light";
    redraw();
  };

  const watcher = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (entry.isIntersecting && !entry.target.dataset.drawn) draw(entry.target);
    }
  }, { rootMargin: "800px" });

  const button = document.getElementById("theme");
  const names = { auto: "Theme: as the system", light: "Theme: light", dark: "Theme: dark" };
  button.hidden = false;
  button.addEventListener("click", () => {
    chosen = { auto: "light", light: "dark", dark: "auto" }[chosen];
    button.textContent = names[chosen];
    theme();
  });
  prefersDark.addEventListener("change", theme);
  const maps = [...document.querySelectorAll(".mapbox")];
  const print = (on) => {
    printing = on;
    // On paper nothing can be opened, so everything is open there, and closed again afterwards.
    document.querySelectorAll("details.branch, details.studied-node, details.every-run").forEach((box) => {
      if (on && !box.open) { box.open = true; box.dataset.opened = "yes"; }
      if (!on && box.dataset.opened) { box.open = false; delete box.dataset.opened; }
    });
    // Nor can another map be chosen. Those that no screen has shown are drawn for the paper.
    if (on) maps.filter((map) => map.hidden).forEach((map) => { map.hidden = false; map.dataset.shown = "yes"; });
    theme();
    if (on) boxes.filter((box) => visible(box) && !box.dataset.drawn).forEach(draw);
    if (!on) maps.filter((map) => map.dataset.shown).forEach((map) => { map.hidden = true; delete map.dataset.shown; });
  };
  window.addEventListener("beforeprint", () => print(true));
  window.addEventListener("afterprint", () => print(false));

  // Maps: one at a time on a screen, all of them on paper.
  const picker = document.getElementById("map-picker");
  if (picker) {
    const show = () => {
      maps.forEach((map) => { map.hidden = map.id !== picker.value; });
      boxes.filter((box) => visible(box) && !box.dataset.drawn && box.closest(".mapbox")).forEach((box) => watcher.observe(box));
      boxes.filter((box) => visible(box) && box.dataset.drawn && box.closest(".mapbox")).forEach((box) => Plotly.Plots.resize(box));
    };
    picker.closest(".tools").hidden = false;
    picker.addEventListener("change", show);
    show();
  }

  // The hierarchy: rows below a folded row are hidden, whatever their own state.
  const fold = (row) => row.querySelector("button.fold");
  const refresh = (table) => {
    let hiddenBelow = Infinity;
    for (const row of table.tBodies[0].rows) {
      if (row.classList.contains("sentences")) {
        const above = row.previousElementSibling;
        row.hidden = above.hidden || above.querySelector("button.tell").getAttribute("aria-expanded") === "false";
        continue;
      }
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
      const control = event.target.closest("button.fold, button.tell");
      if (!control) return;
      control.setAttribute("aria-expanded", String(control.getAttribute("aria-expanded") === "false"));
      refresh(table);
    });
    table.querySelectorAll("button.fold, button.tell").forEach((control) => { control.hidden = false; });
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
  boxes.filter((box) => !box.closest("[hidden]")).forEach((box) => watcher.observe(box));
})();
