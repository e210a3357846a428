"use strict";
(() => {
  const root = document.documentElement;
  const stored = JSON.parse(document.getElementById("films").textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  root.classList.toggle("cw-dark", dark.matches);

  // ---- Scenes: viser's page in a frame, its play bar read and moved from here ------

  // A second play bar would contradict the first, which leads.
  const NO_BAR = "<style>.mantine-Paper-root:has(.mantine-Slider-root){display:none!important}<" + "/style>";

  class Scene {
    constructor(frame, data, leads) {
      this.frame = frame;
      this.data = data;
      this.leads = leads;
      this.load(0);
    }
    load(time) {
      const isDark = root.classList.contains("cw-dark");
      this.wish = time;
      const given = "<script>window.__VISER_EMBED_DATA__=" + JSON.stringify(this.data) +
        `;window.__VISER_EMBED_CONFIG__={darkMode:${isDark}};` + "<" + "/script>";
      this.frame.srcdoc = stored.player.replace("</head>", () => given + (this.leads ? "" : NO_BAR) + "</head>");
    }
    find(query) { const page = this.frame.contentDocument; return page && page.querySelector(query); }
    get time() {
      const slider = this.find("[role=slider]");
      return slider ? Number(slider.getAttribute("aria-valuenow")) : null;
    }
    get duration() { const s = this.find("[role=slider]"); return s ? Number(s.getAttribute("aria-valuemax")) : 0; }
    seek(time) {
      const input = this.find("input.mantine-NumberInput-input");
      if (!input) { this.wish = time; return; }
      const view = this.frame.contentWindow;
      const goal = Math.max(0, Math.min(time, this.duration - 0.001));
      Object.getOwnPropertyDescriptor(view.HTMLInputElement.prototype, "value").set.call(input, goal.toFixed(3));
      input.dispatchEvent(new view.Event("input", { bubbles: true }));
    }
    settle() { // once loaded, go where it was to be
      if (this.wish && this.time !== null) { const time = this.wish; this.wish = 0; this.seek(time); }
    }
  }
  const scenes = [...document.querySelectorAll("iframe[data-scene]")].map(
    (frame, k) => new Scene(frame, stored.films[Number(frame.dataset.scene)], k === 0));

  // ---- Figures: a cursor in each, and the values there -----------------------------

  const charts = [...document.querySelectorAll(".cw-chart")].map((figure) => {
    const plot = figure.querySelector(".cw-plot");
    const [t0, t1, low, high] = ["t0", "t1", "low", "high"].map((k) => Number(figure.dataset[k]));
    const [, , width, height] = plot.querySelector("svg").getAttribute("viewBox").split(" ").map(Number);
    const curves = [...plot.querySelectorAll("path:not(.cw-grid):not(.cw-zero)")].map((path) => {
      const values = new Float64Array(width + 1).fill(NaN);
      let x = 0, y = 0;
      for (const [, word, a, b] of path.getAttribute("d").matchAll(/([Ml])(-?\d+) (-?\d+)/g)) {
        x = word === "M" ? Number(a) : x + Number(a);
        y = word === "M" ? Number(b) : y + Number(b);
        values[x] = high - (y / height) * (high - low);
      }
      return values;
    });
    const cursor = document.createElement("div");
    cursor.className = "cw-cursor";
    plot.append(cursor);
    const outputs = [...figure.querySelectorAll("output")];
    const digits = Math.max(0, Math.min(4, 2 - Math.floor(Math.log10(high - low))));
    const chart = {
      plot,
      at(time) {
        const share = Math.max(0, Math.min(1, (time - t0) / (t1 - t0)));
        cursor.style.left = `${100 * share}%`;
        curves.forEach((values, k) => {
          const value = values[Math.round(share * width)];
          if (outputs[k]) outputs[k].textContent = Number.isNaN(value) ? "" : value.toFixed(digits);
        });
      },
      timeOf(event) {
        const box = plot.getBoundingClientRect();
        return t0 + Math.max(0, Math.min(1, (event.clientX - box.left) / box.width)) * (t1 - t0);
      },
    };
    return chart;
  });

  const dots = [...document.querySelectorAll(".cw-top polyline")].map((line) => {
    const points = line.getAttribute("points").split(" ").map((p) => p.split(",").map(Number));
    const [t0, t1] = [Number(line.dataset.t0), Number(line.dataset.t1)];
    const svg = line.ownerSVGElement;
    const dot = document.createElementNS("http://www.w3.org/2000/svg", "circle");
    dot.setAttribute("r", Math.max(8, svg.viewBox.baseVal.width / 220));
    dot.style.stroke = getComputedStyle(line).stroke;
    svg.append(dot);
    return (time) => {
      const share = Math.max(0, Math.min(1, (time - t0) / (t1 - t0)));
      const [x, y] = points[Math.round(share * (points.length - 1))];
      dot.setAttribute("cx", x);
      dot.setAttribute("cy", y);
    };
  });

  let shown = NaN, hover = null, held = false, chosen = 0;
  const show = (time) => {
    if (time === shown) return;
    shown = time;
    charts.forEach((chart) => chart.at(time));
    dots.forEach((dot) => dot(time));
    root.dataset.time = time.toFixed(3);
  };
  const seek = (time) => { chosen = time; scenes.forEach((scene) => scene.seek(time)); };
  charts.forEach((chart) => {
    chart.plot.addEventListener("pointermove", (event) => {
      hover = chart.timeOf(event);
      if (held) seek(hover);
    });
    chart.plot.addEventListener("pointerdown", (event) => { held = true; seek(chart.timeOf(event)); });
    chart.plot.addEventListener("pointerleave", () => { hover = null; held = false; });
    chart.plot.addEventListener("pointerup", () => { held = false; });
  });

  // ---- The first scene's play bar leads: figures and the other scene follow --------

  const follow = () => {
    scenes.forEach((scene) => scene.settle());
    const lead = scenes.length ? scenes[0].time : null;
    for (const scene of scenes.slice(1)) {
      const time = scene.time;
      if (lead === null || time === null) continue;
      const goal = Math.min(lead, scene.duration - 0.001);
      if (Math.abs(time - goal) > 0.02) scene.seek(goal);
    }
    show(hover ?? lead ?? chosen);
    requestAnimationFrame(follow);
  };
  requestAnimationFrame(follow);

  // ---- Buttons ---------------------------------------------------------------------

  document.getElementById("theme").addEventListener("click", () => {
    root.classList.toggle("cw-dark");
    scenes.forEach((scene) => scene.load(scene.time || 0));
  });
  document.querySelectorAll(".command button").forEach((button) => {
    button.addEventListener("click", async () => {
      const code = button.previousElementSibling;
      try { await navigator.clipboard.writeText(code.textContent); button.textContent = "copied"; }
      catch { const range = document.createRange(); range.selectNodeContents(code);
        const selection = getSelection(); selection.removeAllRanges(); selection.addRange(range); }
      setTimeout(() => { button.textContent = "copy"; }, 1500);
    });
  });
})();
