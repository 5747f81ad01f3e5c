// The fleet page: figures at a glance, and a table that draws only the rows in sight.
"use strict";

(function () {
  const { element, badge, format, duration } = upplied;
  const COLUMNS = [
    { key: "status", label: "Status", wide: "6.4rem" },
    { key: "demonstration", label: "Demonstration", wide: "minmax(10.8rem,1.6fr)" },
    { key: "target", label: "Target", wide: "minmax(7.2rem,1fr)" },
    { key: "state", label: "Decided", wide: "5.4rem", title: "Whether a person released the plan: in force, or a draft" },
    { key: "kind", label: "Kind", wide: "minmax(7.2rem,.6fr)" },
    { key: "coverage", label: "Inspected", wide: "8.4rem", number: true, title: "Share of what the demonstration was about that the plan shows at least as well, where that was computed" },
    { key: "paper", label: "Paper", wide: "4.3rem", number: true, title: "Coverage of the method as published" },
    { key: "baseline", label: "Baseline", wide: "5.4rem", number: true, title: "Coverage of the path scaled by the bounding boxes" },
    { key: "clearance", label: "Clearance", wide: "6.5rem", number: true, title: "Least distance between the path and the structure" },
    { key: "frechet", label: "Fréchet", wide: "5rem", number: true, title: "Continuous Fréchet distance of the standardised paths" },
    { key: "length", label: "Length", wide: "4.7rem", number: true },
    { key: "duration", label: "Time", wide: "3.8rem", number: true },
    { key: "change", label: "What changed", wide: "minmax(7.8rem,1fr)" },
  ];

  upplied.pages.fleet = function (app, fleet, address, about) {
    const rows = fleet.rows.map((values, order) => {
      const row = { order };
      fleet.columns.forEach((name, at) => { row[name] = values[at]; });
      row.text = [row.pair, row.demonstration, row.source, row.target, row.kind, row.status, row.state, row.reason, row.change, ...(row.warnings || [])].join(" ").toLowerCase();
      return row;
    });
    const state = { sort: "order", down: false, shown: rows, search: "", status: "", kind: "", changed: false, warned: false };
    document.title = fleet.title;

    const table = virtualTable(address, about);
    const count = element("span", { class: "count", "aria-live": "polite" });

    function refresh() {
      const words = state.search.toLowerCase().split(/\s+/).filter(Boolean);
      state.shown = rows.filter((row) => (!state.status || row.status === state.status)
        && (!state.kind || row.kind === state.kind) && (!state.changed || row.change) && (!state.warned || (row.warnings || []).length)
        && words.every((word) => row.text.includes(word)));
      state.shown.sort((a, b) => (state.down ? -1 : 1) * compare(a[state.sort], b[state.sort], state.down) || a.order - b.order);
      count.textContent = state.shown.length === rows.length ? rows.length + " transfers" : state.shown.length + " of " + rows.length + " transfers";
      table.show(state.shown);
      for (const button of table.head.querySelectorAll("button")) {
        const sorted = button.dataset.key === state.sort;
        button.parentElement.setAttribute("aria-sort", sorted ? (state.down ? "descending" : "ascending") : "none");
      }
    }

    for (const column of COLUMNS) {
      const button = element("button", { type: "button", "data-key": column.key, title: column.title, onclick: () => {
        state.down = state.sort === column.key ? !state.down : false;
        state.sort = column.key;
        refresh();
      } }, column.label);
      table.head.append(element("div", { role: "columnheader", class: "cell " + column.key + (column.number ? " number" : "") }, button));
    }

    const choice = (key, label, values) => element("select", { "aria-label": label, id: "filter-" + key, onchange: (event) => { state[key] = event.target.value; refresh(); } },
      element("option", { value: "" }, label), values.map((value) => element("option", { value }, value)));
    app.append(
      element("header", { class: "page" }, element("h1", {}, fleet.title), tiles(rows),
        fleet.known > rows.length ? element("p", { class: "note", id: "more" }, "These are the " + rows.length + " of " + fleet.known + " transfers that need a person first. All are in transfers.parquet.") : null),
      element("div", { class: "tools" },
        element("input", { type: "search", id: "search", placeholder: "Search ids, kinds, reasons", "aria-label": "Search", oninput: (event) => { state.search = event.target.value; refresh(); } }),
        choice("status", "Any status", ["ok", "recalled", "not flyable", "refused", "failed"].filter((status) => rows.some((row) => row.status === status))),
        choice("kind", "Any kind", [...new Set(rows.map((row) => row.kind))].sort()),
        element("label", { class: "check" }, element("input", { type: "checkbox", id: "filter-changed", onchange: (event) => { state.changed = event.target.checked; refresh(); } }), "changed only"),
        element("label", { class: "check" }, element("input", { type: "checkbox", id: "filter-warned", onchange: (event) => { state.warned = event.target.checked; refresh(); } }), "with warnings"),
        element("button", { type: "button", id: "worst-first", onclick: () => { state.sort = "order"; state.down = false; refresh(); } }, "Worst first"),
        count),
      table.root);
    refresh();
    return table.leave;
  };

  function compare(a, b, down) {
    const missing = (value) => value === null || value === undefined || value === "";
    if (missing(a) || missing(b)) return (missing(a) - missing(b)) * (down ? -1 : 1);
    return typeof a === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true });
  }

  function tiles(rows) {
    const tile = (value, label, kind) => element("div", { class: "tile " + (kind || "") }, element("b", {}, value), element("span", {}, label));
    const known = (key) => rows.filter((row) => row.status === "ok" && row[key] !== null).map((row) => row[key]).sort((a, b) => a - b);
    const [covers, clears] = [known("coverage"), known("clearance")];
    const number = (status) => rows.filter((row) => row.status === status).length;
    return element("div", { class: "tiles" },
      tile(String(rows.length), "transfers"), tile(String(number("ok")), "planned", "ok"),
      tile(String(rows.filter((row) => row.status === "ok" && (row.warnings || []).length).length), "of them warned of"), tile(String(number("refused")), "refused", number("refused") ? "refused" : ""),
      tile(String(number("failed")), "failed", number("failed") ? "failed" : ""),
      tile(format(covers[Math.floor(covers.length / 2)], 1, " %"), "median inspected"),
      tile(format(clears[0], 1, " m"), "least clearance"));
  }

  function cells(row, address, about) {
    const text = (key, ...content) => element("div", { class: "cell " + key, role: "cell" }, ...content);
    const number = (key, value) => element("div", { class: "cell number " + key, role: "cell" }, value);
    const bar = element("span", { class: "bar" }, element("i", {}));
    bar.firstChild.style.width = Math.max(0, Math.min(100, row.coverage || 0)) + "%";
    const link = row.page ? element("a", { href: address(row.pair) }, row.target) : element("span", { title: "its page could not be made" }, row.target);
    return [
      text("status", badge(row.status), warned(row.warnings || [])), text("demonstration", about ? element("a", { href: about(row.demonstration) }, row.demonstration) : row.demonstration), text("target", link), text("state", row.state), text("kind", row.kind),
      row.status === "ok" || row.status === "not flyable"
        ? element("div", { class: "cell number coverage", role: "cell" }, bar, element("span", { class: "share" }, format(row.coverage, 1, " %")))
        : element("div", { class: "cell coverage reason", role: "cell", title: row.reason }, row.reason || "no reason given"),
      number("paper", format(row.paper, 1)), number("baseline", format(row.baseline, 1)),
      number("clearance", format(row.clearance, 1, " m")), number("frechet", format(row.frechet, 2)),
      number("length", format(row.length, 0, " m")), number("duration", duration(row.duration)), text("change", row.change),
    ];
  }

  function warned(warnings) {
    const said = warnings.length + (warnings.length === 1 ? " warning: " : " warnings: ") + warnings.join(" ");
    return warnings.length ? element("span", { class: "warned", role: "img", title: said, "aria-label": said }, " ⚠" + (warnings.length > 1 ? warnings.length : "")) : null;
  }

  // Only the rows in sight exist; a spacer as tall as all of them keeps the scroll bar honest.
  function virtualTable(address, about) {
    const head = element("div", { class: "row head", role: "row" });
    const body = element("div", { class: "spacer", role: "rowgroup" });
    const view = element("div", { class: "view", tabindex: "0" }, element("div", { class: "sheet" }, head, body));
    const root = element("div", { class: "fleet", role: "table", "aria-label": "Transfers" }, view);
    const grid = COLUMNS.map((column) => column.wide).join(" ");
    view.style.setProperty("--grid", grid);
    const narrow = window.matchMedia("(max-width: 760px)");
    let rows = [];
    let drawn = "";

    function draw() {
      const height = narrow.matches ? 84 : 36;
      body.style.height = rows.length * height + "px";
      const first = Math.max(0, Math.floor((view.scrollTop - head.offsetHeight) / height) - 4);
      const last = Math.min(rows.length, first + Math.ceil(view.clientHeight / height) + 10);
      const wanted = first + ":" + last + ":" + height;
      if (wanted === drawn) return;
      drawn = wanted;
      body.replaceChildren(...rows.slice(first, last).map((row, at) => {
        const made = element("div", { class: "row " + row.status, role: "row", "aria-rowindex": first + at + 2 }, cells(row, address, about));
        made.style.top = (first + at) * height + "px";
        made.style.height = height + "px";
        return made;
      }));
    }

    view.addEventListener("scroll", draw, { passive: true });
    window.addEventListener("resize", draw);
    root.setAttribute("aria-colcount", COLUMNS.length);
    return {
      root, head,
      show(list) { rows = list; drawn = ""; view.scrollTop = 0; root.setAttribute("aria-rowcount", rows.length + 1); draw(); },
      leave() { window.removeEventListener("resize", draw); },
    };
  }
})();
