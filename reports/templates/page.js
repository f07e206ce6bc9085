// What every part of the page uses: packed data, copying, colours, links into folded parts.
"use strict";
const Page = {
  async inflate(base64) {
    const raw = Uint8Array.from(atob(base64.trim()), (c) => c.charCodeAt(0));
    const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  },

  say(text) { document.getElementById("said").textContent = text; },

  async copy(text) {
    try {
      await navigator.clipboard.writeText(text);
    } catch { // a page from disk may not be allowed to
      const area = document.createElement("textarea");
      area.value = text;
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
  },

  reveal() { // opens what the address points to
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    for (let part = target; part; part = part.parentElement) if (part.tagName === "DETAILS") part.open = true;
    target.scrollIntoView();
  },
};

(() => {
  const root = document.documentElement, button = document.getElementById("theme");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const stored = (() => { try { return localStorage.getItem("theme"); } catch { return null; } })();
  if (stored === "dark" || stored === "light") root.dataset.theme = stored;
  const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : dark.matches);
  const tell = () => {
    button.textContent = isDark() ? "Light page" : "Dark page";
    document.dispatchEvent(new Event("theme"));
  };
  button.hidden = false;
  button.addEventListener("click", () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    try { localStorage.setItem("theme", root.dataset.theme); } catch { /* not kept */ }
    tell();
  });
  dark.addEventListener("change", tell);
  tell();

  for (const code of document.querySelectorAll("[data-copy]")) {
    const copy = document.createElement("button");
    copy.type = "button";
    copy.className = "copy";
    copy.textContent = "Copy";
    copy.setAttribute("aria-label", `Copy: ${code.dataset.copy || "command"}`);
    copy.addEventListener("click", async () => {
      await Page.copy(code.textContent);
      copy.textContent = "Copied";
      Page.say("The command is copied.");
      setTimeout(() => { copy.textContent = "Copy"; }, 1500);
    });
    code.after(copy);
  }

  addEventListener("hashchange", Page.reveal);
  document.addEventListener("click", (e) => { // a second click on the same link
    const link = e.target.closest?.("a[href^='#']");
    if (link && link.getAttribute("href") === location.hash) Page.reveal();
  });
  if (location.hash) Page.reveal();

  const closed = new Set(); // details opened for the printer only
  addEventListener("beforeprint", () => {
    for (const part of document.querySelectorAll("details:not([open])")) { closed.add(part); part.open = true; }
  });
  addEventListener("afterprint", () => { for (const part of closed) part.open = false; closed.clear(); });
})();
