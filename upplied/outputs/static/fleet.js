// The fleet page: figures at a glance, and a table that draws only the rows in sight.
"use strict";

(function () {
  const { element, badge, format, duration } = upplied;
  const COLUMNS = [
    { key: "target", label: "Structure", wide: "minmax(11.5rem,1.3fr)" },
    { key: "demonstration", label: "Demonstration", wide: "minmax(9.5rem,1.2fr)" },
    { key: "status", label: "Result", wide: "7.6rem" },
    { key: "state", label: "Decision", wide: "6.4rem", title: "Draft, reviewed, released, rejected or recalled" },
    { key: "coverage", label: "Inspected", wide: "6.6rem", number: true, title: "Share of the inspected surface that the plan shows at the demonstrated quality" },
    { key: "gsd", label: "mm/px", wide: "4.2rem", number: true, title: "Size of a pixel on the surface, median" },
    { key: "clearance", label: "Clearance", wide: "5.8rem", number: true, title: "Smallest distance of the path from the structure" },
    { key: "duration", label: "Time", wide: "4.2rem", number: true, title: "Flight time of the inspection, minutes and seconds" },
    { key: "battery_pct", label: "Battery", wide: "5rem", number: true, title: "Inspection time as a share of the endurance of one battery, without transit legs; set vehicle.endurance_s to see it" },
    { key: "age", label: "Last flown", wide: "6.4rem", title: "Age of the last imported flight of the structure" },
    { key: "change", label: "Change", wide: "minmax(6rem,.9fr)", title: "Difference from the previous plan" },
  ];
  const RESEARCH = [
    { key: "paper", label: "Paper", wide: "4.6rem", number: true, title: "Coverage of the method as published" },
    { key: "baseline", label: "Baseline", wide: "5.6rem", number: true, title: "Coverage of the path scaled by the bounding boxes" },
    { key: "frechet", label: "Fréchet", wide: "5.2rem", number: true, title: "Continuous Fréchet distance of the standardised paths" },
    { key: "length", label: "Length", wide: "5rem", number: true, title: "Length of the path" },
  ];
  const OPERATION = new Set(["battery_pct", "age", "change"]); // they make room for research
  const DAY = 86400000;
  // In words how long ago a flight was; times are in UTC.
  function ago(flown) {
    const days = Math.floor((Date.now() - Date.parse(flown.replace(" ", "T") + "Z")) / DAY);
    return days < 1 ? "today" : days === 1 ? "yesterday" : days + " days ago";
  }

  upplied.pages.fleet = function (app, fleet) {
    const rows = fleet.rows.map((values, order) => {
      const row = { order };
      fleet.columns.forEach((name, at) => { row[name] = values[at]; });
      row.age = row.flown ? Date.parse(row.flown.replace(" ", "T") + "Z") : null;
      row.text = [row.pair, row.demonstration, row.source, row.target, row.kind, row.status, row.state, row.reason, row.change, ...(row.warnings || [])].join(" ").toLowerCase();
      return row;
    });
    const state = { sort: "order", down: false, shown: rows, search: "", status: "", kind: "", changed: false, warned: false };
    document.title = fleet.title;
    upplied.thumbnails = fleet.thumbnails ? upplied.root + "thumbnails/" : "";

    const table = virtualTable(rows.some((row) => row.gsd !== null && row.gsd !== undefined));
    const count = element("span", { class: "count", "aria-live": "polite" });

    function refresh() {
      const words = state.search.toLowerCase().split(/\s+/).filter(Boolean);
      state.shown = rows.filter((row) => (!state.status || row.status === state.status)
        && (!state.kind || row.kind === state.kind) && (!state.changed || row.change) && (!state.warned || (row.warnings || []).length)
        && words.every((word) => row.text.includes(word)));
      state.shown.sort((a, b) => (state.down ? -1 : 1) * compare(a[state.sort], b[state.sort], state.down) || a.order - b.order);
      count.textContent = state.shown.length === rows.length ? rows.length + " plans" : state.shown.length + " of " + rows.length + " plans";
      table.show(state.shown);
      for (const button of table.head.querySelectorAll("button")) {
        const sorted = button.dataset.key === state.sort;
        button.parentElement.setAttribute("aria-sort", sorted ? (state.down ? "descending" : "ascending") : "none");
      }
    }

    function heads() {
      table.head.replaceChildren(...table.columns().map((column) => {
        const button = element("button", { type: "button", "data-key": column.key, title: column.title, onclick: () => {
          state.down = state.sort === column.key ? !state.down : false;
          state.sort = column.key;
          refresh();
        } }, column.label);
        return element("div", { role: "columnheader", class: "cell " + column.key + (column.number ? " number" : "") }, button);
      }));
    }

    const choice = (key, label, values) => element("select", { "aria-label": label, id: "filter-" + key, onchange: (event) => { state[key] = event.target.value; refresh(); } },
      element("option", { value: "" }, label), values.map((value) => element("option", { value }, upplied.words(value))));
    upplied.fill(app,
      element("header", { class: "page" }, element("h1", {}, fleet.title), tiles(rows),
        fleet.known > rows.length ? element("p", { class: "note", id: "more" }, "This page shows the " + rows.length + " plans of " + fleet.known + " that need attention first. transfers.parquet holds all.") : null),
      element("div", { class: "tools" },
        element("input", { type: "search", id: "search", placeholder: "Search IDs, kinds, reasons", "aria-label": "Search", oninput: (event) => { state.search = event.target.value; refresh(); } }),
        choice("status", "Any result", ["ok", "recalled", "not flyable", "refused", "failed"].filter((status) => rows.some((row) => row.status === status))),
        choice("kind", "Any kind", [...new Set(rows.map((row) => row.kind))].sort()),
        element("label", { class: "check" }, element("input", { type: "checkbox", id: "filter-changed", onchange: (event) => { state.changed = event.target.checked; refresh(); } }), "changed only"),
        element("label", { class: "check" }, element("input", { type: "checkbox", id: "filter-warned", onchange: (event) => { state.warned = event.target.checked; refresh(); } }), "with warnings"),
        element("button", { type: "button", id: "worst-first", onclick: () => { state.sort = "order"; state.down = false; refresh(); } }, "Attention first"),
        element("label", { class: "check" }, element("input", { type: "checkbox", id: "research", onchange: (event) => { table.research(event.target.checked); heads(); refresh(); } }), "research columns"),
        count),
      upplied.places(fleet.structures || {}, rows), table.root,
      (fleet.findings || []).length ? element("section", {}, element("h2", {}, "Findings"), upplied.table("Findings", ["Kind", "Class", "Open", "Watched", "Repaired", "Dismissed"],
        fleet.findings.map((row) => [row.map ? element("a", { href: upplied.link("findings", row.kind) }, upplied.words(row.kind)) : upplied.words(row.kind), row.class, ...["open", "watched", "repaired", "dismissed"].map((state) => String(row[state] || 0))]))) : null);
    heads();
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
      tile(String(rows.length), "plans"), tile(String(number("ok")), "ok", "ok"),
      tile(String(rows.filter((row) => row.status === "ok" && (row.warnings || []).length).length), "with warnings"), tile(String(number("refused")), "refused", number("refused") ? "refused" : ""),
      tile(String(number("failed")), "failed", number("failed") ? "failed" : ""),
      tile(format(covers[Math.floor(covers.length / 2)], 1, " %"), "inspected surface shown, median"),
      tile(format(clears[0], 1, " m"), "minimum clearance"));
  }

  function cells(row, columns) {
    const planned = row.status === "ok" || row.status === "not flyable";
    const about = upplied.link("demonstrations", row.demonstration);
    const content = {
      status: () => [badge(row.status), warned(row.warnings || [])],
      demonstration: () => (about ? element("a", { href: about }, row.demonstration) : row.demonstration),
      target: () => [thumbnail(row), element("div", {}, row.page ? element("a", { href: upplied.link("transfers", row.pair) }, row.target) : element("span", { title: "This page could not be written." }, row.target), element("div", { class: "kind" }, upplied.words(row.kind)))],
      coverage: () => (planned ? format(row.coverage, 1, " %") : row.reason || "No reason was recorded."),
      battery_pct: () => format(row.battery_pct, 0, " %"),
      gsd: () => format(row.gsd, 1), clearance: () => format(row.clearance, 1, " m"), duration: () => duration(row.duration),
      age: () => (row.flown ? ago(row.flown) : "never"), paper: () => format(row.paper, 1), baseline: () => format(row.baseline, 1),
      frechet: () => format(row.frechet, 2), length: () => format(row.length, 0, " m"),
    };
    return columns.map(({ key, number }) => {
      const reason = key === "coverage" && !planned;
      return element("div", { class: "cell " + key + (number && !reason ? " number" : "") + (reason ? " reason" : ""), role: "cell", title: reason ? row.reason : null }, key in content ? content[key]() : row[key]);
    });
  }

  // A small picture of the structure; a page in one file has none.
  function thumbnail(row) {
    return upplied.thumbnails && row.page ? element("img", { class: "thumbnail", src: upplied.thumbnails + row.target + ".png", alt: "", loading: "lazy", width: 64, height: 44 }) : null;
  }

  function warned(warnings) {
    const words = warnings.length + (warnings.length === 1 ? " warning: " : " warnings: ") + warnings.join(" ");
    return warnings.length ? element("span", { class: "warned", role: "img", title: words, "aria-label": words }, " ⚠" + (warnings.length > 1 ? warnings.length : "")) : null;
  }

  // Only the rows in sight exist; a spacer as tall as all of them keeps the scroll bar honest.
  function virtualTable(sized) {
    let columns = [];
    const head = element("div", { class: "row head", role: "row" });
    const body = element("div", { class: "spacer", role: "rowgroup" });
    const view = element("div", { class: "view", tabindex: "0", role: "region", "aria-label": "Plans" });
    const root = element("div", { class: "sheet", role: "table", "aria-label": "Plans" }, head, body);
    view.append(root);
    const research = (wanted) => {
      columns = COLUMNS.filter(({ key }) => (key !== "gsd" || sized) && !(wanted && OPERATION.has(key))).concat(wanted ? RESEARCH : []);
      view.style.setProperty("--grid", columns.map((column) => column.wide).join(" "));
      root.setAttribute("aria-colcount", columns.length);
    };
    research(false);
    const narrow = window.matchMedia("(max-width: 760px)");
    let rows = [];
    let drawn = "";

    function draw() {
      const height = narrow.matches ? 96 : 54;
      body.style.height = rows.length * height + "px";
      const first = Math.max(0, Math.floor((view.scrollTop - head.offsetHeight) / height) - 4);
      const last = Math.min(rows.length, first + Math.ceil(view.clientHeight / height) + 10);
      const wanted = first + ":" + last + ":" + height;
      if (wanted === drawn) return;
      drawn = wanted;
      body.replaceChildren(...rows.slice(first, last).map((row, at) => {
        const line = element("div", { class: "row " + row.status, role: "row", "aria-rowindex": first + at + 2 }, cells(row, columns));
        line.style.top = (first + at) * height + "px";
        line.style.height = height + "px";
        return line;
      }));
    }

    view.addEventListener("scroll", draw, { passive: true });
    window.addEventListener("resize", draw);
    return {
      root: element("div", { class: "fleet" }, view), head, research, columns: () => columns,
      show(list) { rows = list; drawn = ""; view.scrollTop = 0; root.setAttribute("aria-rowcount", rows.length + 1); draw(); },
      leave() { window.removeEventListener("resize", draw); },
    };
  }
})();
