// The fleet page: figures at a glance, a map, and a table that draws only the rows in sight.
"use strict";

(function () {
  const { element, badge, fill, format, duration, note, section, tile, words } = upplied;
  const COLUMNS = Object.entries(upplied.labels.fleet), RESEARCH = Object.entries(upplied.labels.fleet_research);
  const OPERATION = new Set(["battery_pct", "age", "change"]); // they make room for research
  const DAY = 86400000;
  const FINDING_STATES = ["open", "watched", "repaired", "dismissed"];
  const flownAt = (row) => (row.flown ? Date.parse(row.flown.replace(" ", "T") + "Z") : null); // times are in UTC

  upplied.pages.fleet = function (app, fleet) {
    const rows = fleet.rows.map((values, order) => {
      const row = { order, warnings: [], ...Object.fromEntries(fleet.columns.map((name, at) => [name, values[at]])) };
      row.age = flownAt(row);
      row.text = [row.pair, row.demonstration, row.source, row.target, row.kind, row.status, row.state, row.reason, row.change, ...row.warnings].join(" ").toLowerCase();
      return row;
    });
    const state = { sort: "order", down: false, search: "", status: "", kind: "", changed: false, warned: false };
    document.title = fleet.title;
    const table = virtualTable(rows.some((row) => Number.isFinite(row.gsd)), fleet.thumbnails ? upplied.root + "thumbnails/" : "");
    const count = element("span", { class: "count", "aria-live": "polite" });

    function refresh(change) {
      Object.assign(state, change);
      const sought = state.search.toLowerCase().split(/\s+/).filter(Boolean);
      const shown = rows.filter((row) => (!state.status || row.status === state.status) && (!state.kind || row.kind === state.kind)
        && (!state.changed || row.change) && (!state.warned || row.warnings.length) && sought.every((word) => row.text.includes(word)));
      shown.sort((a, b) => (state.down ? -1 : 1) * compare(a[state.sort], b[state.sort], state.down) || a.order - b.order);
      count.textContent = (shown.length === rows.length ? "" : shown.length + " of ") + rows.length + " plans";
      table.show(shown);
      for (const button of table.head.querySelectorAll("button")) {
        const sorted = button.dataset.key === state.sort;
        button.parentElement.setAttribute("aria-sort", sorted ? (state.down ? "descending" : "ascending") : "none");
      }
    }

    function heads() {
      const sort = (key) => refresh({ down: state.sort === key && !state.down, sort: key });
      table.head.replaceChildren(...table.columns().map(([key, [label, , title, digits]]) => element("div", { role: "columnheader", class: "cell " + key + (digits === undefined ? "" : " number") },
        element("button", { type: "button", "data-key": key, title: title || null, onclick: () => sort(key) }, label))));
    }

    const choice = (key, label, values) => element("select", { "aria-label": label, id: "filter-" + key, onchange: ({ target }) => refresh({ [key]: target.value }) },
      element("option", { value: "" }, label), values.map((value) => element("option", { value }, words(value))));
    const check = (id, label, act) => element("label", { class: "check" }, element("input", { type: "checkbox", id, onchange: ({ target }) => act(target.checked) }), label);
    fill(app,
      element("header", { class: "page" }, element("h1", {}, fleet.title), tiles(rows),
        fleet.known > rows.length ? note("This page shows the " + rows.length + " plans of " + fleet.known + " that need attention first. transfers.parquet holds all.", "more") : null),
      element("div", { class: "tools" },
        element("input", { type: "search", id: "search", placeholder: "Search IDs, kinds, reasons", "aria-label": "Search", oninput: ({ target }) => refresh({ search: target.value }) }),
        choice("status", "Any result", ["ok", "recalled", "not flyable", "refused", "failed"].filter((status) => rows.some((row) => row.status === status))),
        choice("kind", "Any kind", [...new Set(rows.map((row) => row.kind))].sort()),
        check("filter-changed", "changed only", (changed) => refresh({ changed })), check("filter-warned", "with warnings", (warned) => refresh({ warned })),
        element("button", { type: "button", id: "worst-first", onclick: () => refresh({ sort: "order", down: false }) }, "Attention first"),
        check("research", "research columns", (wanted) => { table.research(wanted); heads(); refresh(); }), count),
      places(fleet.structures || {}, rows), table.root,
      (fleet.findings || []).length ? section("Findings", upplied.table("Findings", ["Kind", "Class", ...FINDING_STATES.map((name) => name[0].toUpperCase() + name.slice(1))],
        fleet.findings.map((row) => [row.map ? element("a", { href: upplied.link("findings", row.kind) }, words(row.kind)) : words(row.kind), row.class,
          ...FINDING_STATES.map((name) => String(row[name] || 0))]))) : null);
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
    const good = rows.filter((row) => row.status === "ok"), number = (status) => rows.filter((row) => row.status === status).length;
    const sorted = (key) => good.map((row) => row[key]).filter((value) => value !== null).sort((a, b) => a - b);
    const [covers, clears] = [sorted("coverage"), sorted("clearance")];
    return element("div", { class: "tiles" },
      tile(String(rows.length), "plans"), tile(String(good.length), "ok", "ok"), tile(String(good.filter((row) => row.warnings.length).length), "with warnings"),
      ["refused", "failed"].map((status) => tile(String(number(status)), status, number(status) ? status : "")),
      tile(format(covers[Math.floor(covers.length / 2)], 1, " %"), "inspected surface shown, median"),
      tile(format(clears[0], 1, " m"), "minimum clearance"));
  }

  // What stands in a cell that is neither a text of the row nor a number with digits and unit.
  const CONTENT = {
    status: (row) => [badge(row.status), warned(row.warnings)],
    demonstration(row) {
      const about = upplied.link("demonstrations", row.demonstration);
      return about ? element("a", { href: about }, row.demonstration) : row.demonstration;
    },
    target: (row, pictures) => [
      pictures && row.page ? element("img", { class: "thumbnail", src: pictures + row.target + ".png", alt: "", loading: "lazy", width: 64, height: 44 }) : null,
      element("div", {}, row.page ? element("a", { href: upplied.link("transfers", row.pair) }, row.target) : element("span", { title: "This page could not be written." }, row.target),
        element("div", { class: "kind" }, words(row.kind)))],
    duration: (row) => duration(row.duration),
    age(row) {
      const days = Math.floor((Date.now() - row.age) / DAY);
      return row.age === null ? "never" : days < 1 ? "today" : days === 1 ? "yesterday" : days + " days ago";
    },
  };

  function cell(row, [key, [, , , digits, unit]], pictures) {
    const reason = key === "coverage" && !["ok", "not flyable"].includes(row.status);
    const content = reason ? row.reason || "No reason was recorded." : key in CONTENT ? CONTENT[key](row, pictures) : digits === undefined ? row[key] : format(row[key], digits, unit);
    return element("div", { class: "cell " + key + (reason ? " reason" : digits === undefined ? "" : " number"), role: "cell", title: reason ? row.reason : null }, content);
  }

  function warned(warnings) {
    const text = warnings.length + (warnings.length === 1 ? " warning: " : " warnings: ") + warnings.join(" ");
    return warnings.length ? element("span", { class: "warned", role: "img", title: text, "aria-label": text }, " ⚠" + (warnings.length > 1 ? warnings.length : "")) : null;
  }

  // A map of structures that have a place: dots by the state of their plans, north up, no tiles from elsewhere.
  function places(structures, rows) {
    const placed = Object.entries(structures).filter(([, { lat }]) => Number.isFinite(lat));
    if (placed.length < 2) return null;
    const squeeze = Math.cos((placed.reduce((sum, [, { lat }]) => sum + lat, 0) / placed.length) * (Math.PI / 180));
    const points = placed.map(([, { lat, lon }]) => [lon * squeeze, -lat]), [[left, right], [top, bottom]] = upplied.bounds(points);
    const size = Math.max(right - left, bottom - top, 1e-6);
    const svg = (tag, attributes, ...children) => {
      const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
      for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
      node.append(...children);
      return node;
    };
    const dots = placed.map(([name], at) => {
      const { status } = rows.find((row) => row.target === name) || { status: "ok" }, [x, y] = points[at];
      return svg("a", { href: upplied.link("structures", name) || "#" },
        svg("circle", { cx: 20 + (560 * (x - left)) / size, cy: 20 + (200 * (y - top)) / size, r: 6, class: "dot " + status.replace(" ", "-") }, svg("title", {}, name + ": " + status)));
    });
    const km = (size / 4) * 111.2;
    const text = (x, y, words) => svg("text", { x, y, "text-anchor": "middle" }, words);
    return element("details", { class: "places" }, element("summary", {}, "Map of " + placed.length + " structures"),
      svg("svg", { viewBox: "0 0 620 250", role: "group", "aria-label": "Places of structures, north up" }, ...dots,
        svg("path", { d: "M600 40 V14 M594 22 L600 12 L606 22", class: "north" }), text(600, 54, "N"),
        svg("path", { d: "M20 240 H160", class: "north" }), text(90, 234, km >= 1 ? km.toFixed(0) + " km" : (1000 * km).toFixed(0) + " m")));
  }

  // Only the rows in sight exist; a spacer as tall as all of them keeps the scroll bar honest.
  function virtualTable(sized, pictures) {
    let columns = [], rows = [], drawn = "";
    const head = element("div", { class: "row head", role: "row" });
    const body = element("div", { class: "spacer", role: "rowgroup" });
    const root = element("div", { class: "sheet", role: "table", "aria-label": "Plans" }, head, body);
    const view = element("div", { class: "view", tabindex: "0", role: "region", "aria-label": "Plans" }, root);
    const research = (wanted) => {
      columns = COLUMNS.filter(([key]) => (key !== "gsd" || sized) && !(wanted && OPERATION.has(key))).concat(wanted ? RESEARCH : []);
      view.style.setProperty("--grid", columns.map(([, [, width]]) => width).join(" "));
      root.setAttribute("aria-colcount", columns.length);
    };
    research(false);
    const narrow = window.matchMedia("(max-width: 760px)");

    function draw() {
      const height = narrow.matches ? 96 : 54;
      body.style.height = rows.length * height + "px";
      const first = Math.max(0, Math.floor((view.scrollTop - head.offsetHeight) / height) - 4);
      const last = Math.min(rows.length, first + Math.ceil(view.clientHeight / height) + 10);
      const wanted = first + ":" + last + ":" + height;
      if (wanted === drawn) return;
      drawn = wanted;
      body.replaceChildren(...rows.slice(first, last).map((row, at) => {
        const line = element("div", { class: "row " + row.status, role: "row", "aria-rowindex": first + at + 2 }, columns.map((column) => cell(row, column, pictures)));
        Object.assign(line.style, { top: (first + at) * height + "px", height: height + "px" });
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
