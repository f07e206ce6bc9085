// The page of a running campaign: asks for the summary, and replaces what it shows.
"use strict";
(() => {
  const EVERY = 2000; // ms between two questions
  const LEFT = 40, WIDTH = 800, TOP = 14, HEIGHT = 110; // px of the curve
  const show = (id, text) => { const e = document.getElementById(id); if (e.textContent !== text) e.textContent = text; };
  const count = (n, one, many) => `${n} ${n === 1 ? one : many}`;
  let before = "";

  function draw(points) {
    const svg = document.getElementById("curve"), make = (tag, set, text) => {
      const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
      for (const [name, value] of Object.entries(set)) made.setAttribute(name, value);
      if (text !== undefined) made.textContent = text;
      return made;
    };
    const [last, most] = points[points.length - 1];
    const x = (n) => LEFT + (WIDTH * n) / Math.max(last, 1), y = (n) => TOP + HEIGHT * (1 - n / Math.max(most, 1));
    const line = (k, style) => make("polyline", { fill: "none", points: [[0, 0, 0], ...points]
      .map((row) => `${x(row[0]).toFixed(1)},${y(row[k]).toFixed(1)}`).join(" "), ...style });
    svg.replaceChildren(
      make("line", { x1: LEFT, x2: LEFT + WIDTH, y1: y(0), y2: y(0), stroke: "var(--line)" }),
      line(1, { stroke: "var(--bad)", "stroke-width": 2 }),
      line(2, { stroke: "var(--ink)", "stroke-width": 1.5, "stroke-dasharray": "5 3" }),
      make("text", { x: LEFT - 6, y: y(most) + 4, class: "tick", "text-anchor": "end" }, most),
      make("text", { x: LEFT - 6, y: y(0) + 4, class: "tick", "text-anchor": "end" }, 0),
      make("text", { x: LEFT + WIDTH, y: y(0) + 18, class: "tick", "text-anchor": "end" }, `${last} trials`),
      make("text", { x: LEFT, y: y(0) + 18, class: "tick" }, "solid: failures, dashed: deadlocks"));
  }

  function lichtblickLink(address, id) {
    const run = `${location.origin}/runs/${id}.mcap`, link = document.createElement("a");
    link.href = `${address}/?ds=remote-file&ds.url=${encodeURIComponent(run)}`;
    link.textContent = `open ${id} in Lichtblick`;
    link.rel = "noreferrer";
    return link;
  }

  function tell(data) {
    const { judged, failed } = data, { deadlock, stuck, shut } = data.kinds;
    const others = failed - deadlock - stuck - shut;
    show("headline", `${count(judged, "trial", "trials")}${data.budget ? ` of ${data.budget}` : ""}: ` +
      `${count(deadlock, "deadlock", "deadlocks")}, ${stuck} stuck, ${count(others, "other failure", "other failures")}` +
      (shut ? `, ${shut} shut by the world` : ""));
    show("state", `${data.running ? "Running" : "Not running"}; ${data.hours.toFixed(2)} h simulated; ` +
      `${count(data.rejected, "scene", "scenes")} rejected or impossible, ${count(data.errors, "error", "errors")} of the toolkit.`);
    show("latest", data.latest ? `Latest: ${data.latest}` : "No failure yet.");
    document.getElementById("list").replaceChildren(...data.modes.map(([n, happened, first]) => {
      const item = document.createElement("li");
      item.textContent = `${count(n, "trial", "trials")}, first ${first}: ${happened} `;
      if (data.lichtblick) item.append(lichtblickLink(data.lichtblick, first));
      return item;
    }));
    show("further", data.further_modes ? `${data.further_modes} further modes.` : "");
    draw(data.points);
    if (data.latest !== before) { before = data.latest; Page.say(data.latest); }
  }

  async function ask() {
    try {
      const answer = await fetch("summary.json", { cache: "no-store" });
      if (!answer.ok) throw new Error(await answer.text());
      tell(await answer.json());
    } catch (error) {
      show("state", `The server does not answer: ${error.message}. Is mrta-falsify serve still running?`);
    }
    setTimeout(ask, EVERY);
  }
  ask();
})();
