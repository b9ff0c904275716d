/* Trends and maps of a campaign: one number of every recording over speed, load or temperature. */
(() => {
  "use strict";
  const source = document.getElementById("campaign"), field = document.getElementById("explore-field");
  if (!source || !field || typeof uPlot === "undefined") return;
  const book = JSON.parse(source.textContent);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const column = (item) => Array.from(new Float32Array(bytes(item)), (v) => (isFinite(v) ? v : null));
  const read = (item) => ({ label: item.label, unit: item.unit, v: column(item.v), e: item.e ? column(item.e) : [] });
  const over = book.conditions.map(read), quantities = book.quantities.map(read);
  const title = (item) => item.label + (item.unit ? " [" + item.unit + "]" : "");
  const color = (tone) => getComputedStyle(document.documentElement).getPropertyValue("--" + tone).trim();
  const text = (value, item) => (value === null ? "\u2013" : value.toPrecision(4).replace("-", "\u2212") + (item.unit ? " " + item.unit : ""));
  const [pickQ, pickX, pickY] = ["quantity", "over", "by"].map((name) => document.getElementById("explore-" + name));
  const readout = document.getElementById("explore-readout");
  const option = (select, label, value) => { const item = document.createElement("option"); item.textContent = label; item.value = value; select.append(item); };
  quantities.forEach((item, k) => option(pickQ, title(item), k));
  over.forEach((item, k) => option(pickX, title(item), k));
  option(pickY, "nothing else", "-1");
  over.forEach((item, k) => option(pickY, title(item) + " (map)", k));
  let u = null, rows = [], at = -1;

  function points(plot) {
    const { ctx } = plot, size = 4 * devicePixelRatio, q = quantities[pickQ.value], map = pickY.value !== "-1";
    const found = rows.map((k) => q.v[k]), low = Math.min(...found), high = Math.max(...found);
    ctx.save();
    rows.forEach((k, place) => {
      const x = plot.valToPos(plot.data[0][place], "x", true), y = plot.valToPos(plot.data[1][place], "y", true);
      const share = high > low ? (q.v[k] - low) / (high - low) : 0.5;
      ctx.fillStyle = ctx.strokeStyle = color(map ? book.ramp[Math.round(share * (book.ramp.length - 1))] : "fitted");
      if (!map && q.e[k]) {
        ctx.beginPath(); ctx.moveTo(x, plot.valToPos(q.v[k] - q.e[k], "y", true)); ctx.lineTo(x, plot.valToPos(q.v[k] + q.e[k], "y", true)); ctx.stroke();
      }
      ctx.beginPath(); ctx.arc(x, y, k === at ? 1.8 * size : size, 0, 7); ctx.fill();
      if (k === at) { ctx.strokeStyle = color("ink"); ctx.lineWidth = 2 * devicePixelRatio; ctx.stroke(); }
    });
    ctx.restore();
  }

  function show(k) {
    at = k;
    const q = quantities[pickQ.value], x = over[pickX.value];
    readout.textContent = k < 0 ? "" : book.names[k] + ": " + q.label + " " + text(q.v[k], q) + (q.e[k] ? " \u00b1 " + q.e[k].toPrecision(2) : "") + ", " + x.label + " " + text(x.v[k], x) + (pickY.value !== "-1" ? ", " + over[pickY.value].label + " " + text(over[pickY.value].v[k], over[pickY.value]) : "");
    u.redraw(false);
  }

  function nearest(event) {
    const { left, top } = u.over.getBoundingClientRect(), x = event.clientX - left, y = event.clientY - top;
    let best = -1, least = 900;
    rows.forEach((k, place) => {
      const d = (u.valToPos(u.data[0][place], "x") - x) ** 2 + (u.valToPos(u.data[1][place], "y") - y) ** 2;
      if (d < least) { least = d; best = k; }
    });
    return best;
  }

  const grow = (lo, hi) => (lo === null ? [0, 1] : lo === hi ? [lo - (Math.abs(lo) * 0.05 || 1), hi + (Math.abs(hi) * 0.05 || 1)] : [lo - 0.06 * (hi - lo), hi + 0.06 * (hi - lo)]);
  const axis = (label, extra) => Object.assign({ label, stroke: () => color("muted"), labelFont: "12px system-ui, sans-serif", font: "12px system-ui, sans-serif", grid: { stroke: () => color("grid"), width: 1 }, ticks: { stroke: () => color("axis"), width: 1, size: 4 }, values: (plot, all) => all.map((v) => (v === null ? "" : String(+v.toPrecision(6)).replace("-", "\u2212"))) }, extra);

  function build() {
    const q = quantities[pickQ.value], x = over[pickX.value], y = pickY.value === "-1" ? q : over[pickY.value];
    rows = book.names.map((_, k) => k).filter((k) => q.v[k] !== null && x.v[k] !== null && y.v[k] !== null).sort((a, b) => x.v[a] - x.v[b]);
    at = -1;
    if (u) u.destroy();
    u = new uPlot({
      width: Math.max(field.clientWidth, 200), height: 380, legend: { show: false },
      scales: { x: { time: false, range: (plot, lo, hi) => grow(lo, hi) }, y: { range: (plot, lo, hi) => (y === q ? grow(Math.min(...rows.map((k) => q.v[k] - (q.e[k] || 0))), Math.max(...rows.map((k) => q.v[k] + (q.e[k] || 0)))) : grow(lo, hi)) } },
      series: [{}, { paths: () => null, points: { show: false } }],
      cursor: { points: { show: false }, drag: { x: true, y: true, uni: 20 } },
      axes: [axis(title(x), { labelSize: 18, size: 30 }), axis(title(y), { size: 62, labelSize: 18 })],
      hooks: { draw: [points] },
    }, [rows.map((k) => x.v[k]), rows.map((k) => y.v[k])], field);
    u.over.addEventListener("mousemove", (event) => { const k = nearest(event); if (k !== at) show(k); });
    u.over.addEventListener("click", () => { if (at >= 0) location.assign(book.links[at]); });
    show(-1);
  }

  field.addEventListener("keydown", (event) => {
    const place = rows.indexOf(at), last = rows.length - 1;
    const go = { ArrowRight: Math.min(place + 1, last), ArrowLeft: Math.max(place - 1, 0), Home: 0, End: last }[event.key];
    if (go !== undefined) { show(rows[go]); event.preventDefault(); }
    if (event.key === "Enter" && at >= 0) location.assign(book.links[at]);
  });
  [pickQ, pickX, pickY].forEach((select) => select.addEventListener("change", build));
  document.getElementById("explore").hidden = false;
  document.querySelectorAll(".unexplored").forEach((node) => node.classList.add("explored"));
  build();
  new ResizeObserver(() => { if (Math.abs(u.width - field.clientWidth) > 1 && field.clientWidth > 60) u.setSize({ width: field.clientWidth, height: 380 }); }).observe(field);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => u.redraw(false, true));
  window.explore = { plot: () => u, rows: () => rows, at: () => at };
})();
