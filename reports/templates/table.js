// The table of all trials: sorts, filters, shows a part at a time.
"use strict";
(() => {
  const FIXED = 6; // columns before the parameters
  const AT_ONCE = 50; // rows; more on request
  const FEW = 6; // parameters shown at first
  const CONDITION = /^(.+?)(<=|>=|<|>|=)([^<>=]+)$/;

  function element(tag, properties = {}, ...children) {
    const made = Object.assign(document.createElement(tag), properties);
    made.append(...children);
    return made;
  }

  function shown(value) {
    if (value === null) return "";
    if (typeof value !== "number" || Number.isInteger(value)) return String(value);
    return String(Number(Math.abs(value) < 1 ? value.toPrecision(4) : value.toFixed(3)));
  }

  class TrialTable {
    constructor(root, { columns, rows }) {
      this.columns = columns;
      this.rows = rows;
      this.order = { column: 0, down: false };
      this.most = AT_ONCE;
      this.build(root);
      this.draw();
    }

    build(root) {
      this.filter = element("input", { type: "search", placeholder: "deadlock score<0" });
      this.outcome = element("select", {}, element("option", { value: "", textContent: "all" }),
        ...[...new Set(this.rows.map((row) => row[1]))].sort().map((name) => element("option", { value: name, textContent: name })));
      this.all = element("input", { type: "checkbox" });
      this.count = element("output");
      this.head = element("tr");
      this.body = element("tbody");
      this.more = element("button", { type: "button", textContent: "Show more rows" });
      const table = element("table", {}, element("caption", { className: "unseen", textContent: "All trials with their parameters" }),
        element("thead", {}, this.head), this.body);
      const frame = element("div", { className: "wide", tabIndex: 0 }, table);
      frame.setAttribute("role", "group");
      frame.setAttribute("aria-label", "all trials");
      const controls = element("div", { className: "controls" },
        element("label", {}, "filter ", this.filter), element("label", {}, "outcome ", this.outcome));
      if (this.columns.length > FIXED + FEW) controls.append(element("label", {}, this.all, " all parameters"));
      controls.append(this.count);
      root.append(controls, element("p", { className: "soft", textContent:
        "Filter by words and by conditions such as found<60. The parameters that failing goes with come first." }), frame, this.more);
      const again = () => { this.most = AT_ONCE; this.draw(); };
      this.filter.addEventListener("input", again);
      this.outcome.addEventListener("change", again);
      this.all.addEventListener("change", again);
      this.more.addEventListener("click", () => { this.most += 4 * AT_ONCE; this.draw(); });
    }

    accepts() { // the filter as a function of a row
      const tests = this.filter.value.toLowerCase().split(/\s+/).filter(Boolean).map((word) => {
        const found = CONDITION.exec(word);
        const column = found ? this.columns.findIndex((name) => name.toLowerCase().startsWith(found[1])) : -1;
        if (column < 0) return (row) => row.slice(0, 3).some((cell) => String(cell).toLowerCase().includes(word));
        const limit = Number(found[3]), holdsWord = (cell) => found[2] === "=" && cell.toLowerCase().startsWith(found[3]);
        const holds = { "<": (x) => x < limit, ">": (x) => x > limit, "<=": (x) => x <= limit, ">=": (x) => x >= limit, "=": (x) => x === limit };
        const number = (cell) => typeof cell === "string" ? Number.parseFloat(cell) : Number(cell); // "90 deg" is 90
        return (row) => row[column] !== null &&
          (Number.isNaN(number(row[column])) ? holdsWord(row[column]) : holds[found[2]](number(row[column])));
      });
      const outcome = this.outcome.value;
      return (row) => (!outcome || row[1] === outcome) && tests.every((test) => test(row));
    }

    draw() {
      const { column, down } = this.order, width = this.all.checked ? this.columns.length : FIXED + FEW;
      const before = (a, b) => {
        if (a[column] === null || b[column] === null) return (a[column] === null) - (b[column] === null);
        const sign = a[column] < b[column] ? -1 : a[column] > b[column] ? 1 : 0;
        return down ? -sign : sign;
      };
      const rows = this.rows.filter(this.accepts()).sort(before);
      this.head.replaceChildren(...this.columns.slice(0, width).map((name, i) => this.heading(name, i)));
      this.body.replaceChildren(...rows.slice(0, this.most).map((row) => this.row(row.slice(0, width))));
      this.count.textContent = `${rows.length} of ${this.rows.length} trials`;
      this.more.hidden = rows.length <= this.most;
    }

    heading(name, number) {
      const { column, down } = this.order, button = element("button", { type: "button", textContent: name });
      const cell = element("th", { scope: "col" }, button);
      if (number === column) cell.setAttribute("aria-sort", down ? "descending" : "ascending");
      button.addEventListener("click", () => {
        this.order = { column: number, down: number === column ? !down : false };
        this.draw();
        this.head.children[number].firstChild.focus();
      });
      return cell;
    }

    row(cells) {
      return element("tr", {}, ...cells.map((value, i) => {
        const text = shown(value), cell = element("td", { className: i === 0 || i === 1 ? "" : "n" });
        if (i === 0 && document.getElementById(`trial-${text}`)) cell.append(element("a", { href: `#trial-${text}`, textContent: text }));
        else if (i === 2 && value && document.getElementById(`mode-${text}`)) cell.append(element("a", { href: `#mode-${text}`, textContent: text }));
        else cell.textContent = text;
        if (i === 1) cell.classList.add({ deadlock: "bad", stuck: "bad", failure: "bad", pass: "good" }[value] || "soft");
        return cell;
      }));
    }
  }

  for (const root of document.querySelectorAll(".trials")) {
    const watch = new IntersectionObserver(async (entries) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      watch.disconnect();
      const bytes = await Page.inflate(root.querySelector("script").textContent);
      root.table = new TrialTable(root, JSON.parse(new TextDecoder().decode(bytes)));
    }, { rootMargin: "400px" });
    watch.observe(root);
  }
})();
