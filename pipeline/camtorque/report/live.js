/* Curves that one can zoom, hover and switch, drawn by uPlot from the data in the page. Without this script the page
   shows the same curves as drawings. Nothing is requested, no text becomes HTML. */
(() => {
  "use strict";
  const source = document.getElementById("curves");
  if (!source || typeof uPlot === "undefined") return;
  const book = JSON.parse(source.textContent);
  const groups = new Map();
  const root = document.documentElement;
  const color = (tone) => getComputedStyle(root).getPropertyValue("--" + tone).trim();
  const make = (tag, className, text) => {
    const node = document.createElement(tag);
    if (className) node.className = className;
    if (text !== undefined) node.textContent = text;
    return node;
  };
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const values = (item) => Array.from(new Int16Array(bytes(item.d)), (n) => (n === -32768 ? null : item.o + item.k * n));
  const minus = (text) => text.replace("-", "\u2212");
  const digits = (value, range) => {
    if (value === null || value === undefined || !isFinite(value)) return "\u2013";
    const decimals = Math.max(0, Math.min(6, 3 - Math.floor(Math.log10(range || 1))));
    return minus(value.toFixed(decimals));
  };
  const unit = (ordinate) => { const found = /\[(.*)\]/.exec(ordinate); return found ? " " + found[1] : ""; };

  class Group {
    constructor(name) {
      this.name = name; this.plots = []; this.busy = false; this.timer = 0;
      this.tools = document.querySelector('[data-tools="' + name + '"]');
      this.readout = null; this.live = document.getElementById("announcer");
    }
    zoom(min, max, from) {
      if (this.busy) return;
      this.busy = true;
      for (const plot of this.plots) if (plot.u !== from) plot.u.setScale("x", { min, max });
      this.busy = false;
    }
    limits() { return this.plots[0].full; }
    window() { const s = this.plots[0].u.scales.x; return [s.min, s.max]; }
    scale(factor) {
      const [a, b] = this.window(), [lo, hi] = this.limits(), at = this.at === undefined ? 0.5 * (a + b) : this.x(this.at);
      const middle = at >= a && at <= b ? at : 0.5 * (a + b), half = 0.5 * (b - a) * factor;
      this.zoom(Math.max(lo, middle - half), Math.min(hi, middle + half));
    }
    shift(share) {
      const [a, b] = this.window(), [lo, hi] = this.limits();
      const step = Math.max(lo - a, Math.min(hi - b, share * (b - a)));
      this.zoom(a + step, b + step);
    }
    x(index) { return this.plots[0].u.data[0][index]; }
    move(index, speak) {
      this.at = index;
      const x = this.x(index), [a, b] = this.window();
      if (x < a || x > b) { const half = 0.5 * (b - a); this.zoom(Math.max(this.limits()[0], x - half), Math.min(this.limits()[1], x + half)); }
      for (const { u } of this.plots) u.setCursor({ left: u.valToPos(x, "x"), top: 0.5 * u.over.clientHeight });
      if (speak) {
        clearTimeout(this.timer);
        this.timer = setTimeout(() => { this.live.textContent = speak(index); }, 250);
      }
    }
    tell(index) {
      this.at = index;
      if (!this.readout) return;
      const x = this.x(index);
      const phase = book.phases.find((span) => x >= span.a && x <= span.b);
      const loud = this.plots[0].chart.spans.find((span) => span.loud && x >= span.a && x <= span.b);
      this.readout.textContent = digits(x, 360) + " deg" + (phase ? ", " + phase.l : "") + (loud ? ", " + loud.l : "") + (this.name_of ? ", " + this.name_of : "");
    }
  }

  function shade(chart) {
    return (u) => {
      const { left, top, width, height } = u.bbox;
      u.ctx.save();
      u.ctx.beginPath(); u.ctx.rect(left, top, width, height); u.ctx.clip();
      for (const span of chart.spans) {
        const a = u.valToPos(span.a, "x", true), b = u.valToPos(span.b, "x", true);
        u.ctx.fillStyle = color(span.loud ? "warnsoft" : "soft");
        u.ctx.fillRect(a, top, b - a, height);
      }
      u.ctx.restore();
      if (!u.first) return;
      u.ctx.save();
      u.ctx.font = 11 * devicePixelRatio + "px sans-serif";
      u.ctx.textAlign = "center";
      let taken = -Infinity;
      for (const span of chart.spans) {
        const a = Math.max(u.valToPos(span.a, "x", true), left), b = Math.min(u.valToPos(span.b, "x", true), left + width);
        const half = 0.5 * u.ctx.measureText(span.l).width, middle = 0.5 * (a + b);
        if (b <= a || (span.loud ? middle - half < taken : b - a < 2 * half)) continue;
        if (span.loud) taken = middle + half + 4 * devicePixelRatio;
        u.ctx.fillStyle = color(span.loud ? "warn" : "muted");
        u.ctx.fillText(span.l, middle, span.loud ? top + height - 5 * devicePixelRatio : top - 5 * devicePixelRatio);
      }
      u.ctx.restore();
    };
  }

  function bars(panel, errors, shift) {
    return (u) => {
      u.ctx.save();
      u.ctx.beginPath(); u.ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height); u.ctx.clip();
      u.ctx.lineWidth = 1.2 * devicePixelRatio;
      panel.lines.forEach((item, k) => {
        if (!errors[k] || !u.series[k + 1 + shift].show) return;
        u.ctx.strokeStyle = color(item.t);
        u.data[0].forEach((x, i) => {
          const y = u.data[k + 1 + shift][i], e = errors[k][i];
          if (y === null || !e) return;
          const left = u.valToPos(x, "x", true);
          u.ctx.beginPath(); u.ctx.moveTo(left, u.valToPos(y - e, "y", true)); u.ctx.lineTo(left, u.valToPos(y + e, "y", true)); u.ctx.stroke();
        });
      });
      u.ctx.restore();
    };
  }

  function zero(panel) {
    return (u) => {
      const { min, max } = u.scales.y;
      if (!panel.zero || !(min < 0 && max > 0)) return;
      const y = Math.round(u.valToPos(0, "y", true));
      u.ctx.save(); u.ctx.strokeStyle = color("axis"); u.ctx.lineWidth = devicePixelRatio;
      u.ctx.beginPath(); u.ctx.moveTo(u.bbox.left, y); u.ctx.lineTo(u.bbox.left + u.bbox.width, y); u.ctx.stroke(); u.ctx.restore();
    };
  }

  function axis(tone, extra) {
    return Object.assign({ stroke: () => color("muted"), grid: { stroke: () => color("grid"), width: 1 }, ticks: { stroke: () => color("axis"), width: 1, size: 4 }, font: "12px system-ui, sans-serif" }, extra);
  }

  function edges(x) {
    const a = x[0], b = x[x.length - 1], margin = 0.03 * (b - a) || 1;
    return [a - margin, b + margin];
  }

  function turnSplits(u, k, min, max) {
    const step = [1, 2, 5, 10, 15, 30, 45, 90].find((s) => (max - min) / s <= Math.max(3, u.width / 90)) || 90;
    const found = [];
    for (let v = Math.ceil(min / step - 1e-9) * step; v <= max + 1e-9; v += step) found.push(v);
    return found;
  }

  function draw(chart, panel, x, number, group, host) {
    const last = number === chart.panels.length - 1, full = chart.turn ? [0, 360] : edges(x);
    const lines = panel.lines.map((item) => values(item.v)), errors = panel.lines.map((item) => (item.e ? values(item.e) : null));
    const ends = panel.bands.map((item) => [values(item.lo), values(item.hi)]);
    const shift = 2 * ends.length;
    const data = [x, ...ends.flat(), ...lines];
    const finite = lines.flat().filter((v) => v !== null);
    const range = finite.length ? finite.reduce((m, v) => Math.max(m, v), -Infinity) - finite.reduce((m, v) => Math.min(m, v), Infinity) : 1;
    const series = [{}];
    for (const item of ends.flat()) series.push({ stroke: "transparent", width: 0, points: { show: false } });
    for (const item of panel.lines) {
      series.push({ label: item.l, stroke: () => color(item.t), width: item.p ? 0 : item.w, dash: item.s.length ? item.s : undefined,
        paths: item.p ? () => null : undefined, points: item.p ? { show: true, size: 6, fill: () => color(item.t) } : { show: false } });
    }
    const box = make("div", "panel");
    const legend = make("div", "keys");
    box.append(make("div", "ordinate", panel.y), legend);
    const field = make("div", "field");
    box.append(field);
    host.append(box);
    const options = {
      width: Math.max(host.clientWidth, 200), height: panel.h + (last ? 48 : 14) + (number ? 0 : 10), padding: [number || !chart.spans.length ? 8 : 18, 12, 0, 0], legend: { show: false },
      scales: { x: { time: false, range: (u, lo, hi) => (lo === null ? full : [lo <= x[0] ? full[0] : lo, hi >= x[x.length - 1] ? full[1] : hi]) }, y: panel.lim ? { range: (u, lo, hi) => (u.whole ? panel.lim : uPlot.rangeNum(lo, hi, 0.1, false)) } : { range: (u, lo, hi) => (lo === null ? [0, 1] : lo === hi ? [lo - 1, hi + 1] : [lo - 0.06 * (hi - lo), hi + 0.06 * (hi - lo)]) } },
      series, bands: panel.bands.map((item, k) => ({ series: [2 * k + 2, 2 * k + 1], fill: () => color(item.t) + "bb" })),
      focus: { alpha: chart.links.length ? 0.25 : 1 },
      cursor: { focus: { prox: chart.links.length ? 24 : -1 }, sync: { key: group.name, scales: ["x", null], setSeries: false }, drag: { x: true, y: false, uni: 10 }, y: false, points: { size: 7 } },
      axes: [
        axis("x", { label: last ? chart.label : null, labelSize: last ? 18 : 0, labelFont: "12px system-ui, sans-serif", size: last ? 28 : 6, values: last ? (u, all) => all.map((v) => (v === null ? "" : minus(String(+v.toFixed(4))))) : () => [], splits: chart.turn ? turnSplits : undefined }),
        axis("y", { size: 58, space: panel.h < 130 ? 20 : 30, values: (u, all) => all.map((v) => (v === null ? "" : minus(String(+v.toPrecision(6))))) }),
      ],
      hooks: {
        drawClear: [shade(chart)], draw: [zero(panel), bars(panel, errors, shift)],
        setScale: [(u, key) => { if (key === "x") { const s = u.scales.x; u.whole = s.min <= full[0] && s.max >= full[1]; group.zoom(s.min, s.max, u); } }],
        setSeries: [(u, k, opts) => { if (chart.links.length && opts.focus !== undefined && u.over.matches(":hover")) { u.near = k; group.name_of = k ? panel.lines[k - 1 - shift].l : ""; if (u.cursor.idx !== null && u.cursor.idx !== undefined) group.tell(u.cursor.idx); } }],
        setCursor: [(u) => { const k = u.cursor.idx; rows.forEach((show) => show(k)); if (k !== null && k !== undefined) group.tell(k); }],
      },
    };
    const rows = [];
    const u = new uPlot(options, data, field);
    u.first = number === 0; u.whole = true;
    const key = (label, tone, picked, dashed) => {
      const button = make("button", "key"); button.type = "button"; button.setAttribute("aria-pressed", "true");
      const swatch = make("i", "swatch" + (dashed ? " dashed" : "")); swatch.style.setProperty("--of", "var(--" + tone + ")");
      const value = make("span", "value");
      button.append(swatch, make("span", "", label), value);
      button.addEventListener("click", () => {
        const on = button.getAttribute("aria-pressed") !== "true";
        button.setAttribute("aria-pressed", String(on));
        u.batch(() => picked.forEach((k) => u.setSeries(k, { show: on })));
      });
      legend.append(button);
      return value;
    };
    if (panel.keys) panel.lines.forEach((item, k) => {
      const value = key(item.l, item.t, [k + 1 + shift], item.s.length > 0);
      rows.push((index) => { value.textContent = index === null || index === undefined ? "" : digits(lines[k][index], range); });
    });
    panel.bands.forEach((item, k) => { key(item.l, item.t, [2 * k + 1, 2 * k + 2], false); });
    const plot = { u, chart, panel, host, full, say: (index) => !panel.keys && panel.lines.length > 1 ? panel.y + ": " + panel.lines.length + " curves, " + digits(lines.reduce((m, all) => Math.min(m, all[index]), Infinity), range) + " to " + digits(lines.reduce((m, all) => Math.max(m, all[index]), -Infinity), range) : panel.lines.map((item, k) => (u.series[k + 1 + shift].show ? item.l + " " + digits(lines[k][index], range) + unit(panel.y) : "")).filter(Boolean).join(", ") };
    u.over.addEventListener("dblclick", () => group.zoom(...full));
    touch(u, group);
    if (chart.links.length) {
      u.over.classList.add("opens");
      let x0 = 0;
      u.over.addEventListener("mousedown", (event) => { x0 = event.clientX; });
      u.over.addEventListener("click", (event) => { if (u.near && Math.abs(event.clientX - x0) < 4) location.assign(chart.links[u.near - 1 - shift]); });
    }
    return plot;
  }

  /* Two fingers zoom and move, one moves a zoomed curve sideways (up and down it scrolls the page), a tap sets the cursor,
     a double tap shows all. */
  function touch(u, group) {
    const fingers = new Map(), over = u.over;
    let from = null, tapped = 0, moved = false;
    const grab = () => {
      const at = [...fingers.values()].map((x) => u.posToVal(x, "x"));
      from = at.length ? { at, window: group.window() } : null;
    };
    const place = (event) => event.clientX - over.getBoundingClientRect().left;
    over.addEventListener("pointerdown", (event) => {
      if (event.pointerType !== "touch") return;
      if (!fingers.size) moved = false;
      fingers.set(event.pointerId, place(event));
      grab();
    });
    over.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId) || fingers.size > 2) return;
      const [lo, hi] = group.limits(), whole = from.window[1] - from.window[0] >= hi - lo;
      if (Math.abs(place(event) - fingers.get(event.pointerId)) > 3) moved = true;
      fingers.set(event.pointerId, place(event));
      const now = [...fingers.values()], width = over.clientWidth;
      if (now.length === 1 && whole) return;
      const spread = now.length === 2 ? (from.at[1] - from.at[0]) / (now[1] - now[0] || 1) : (from.window[1] - from.window[0]) / width;
      if (!(spread > 0)) return;
      const size = Math.min(Math.max(spread * width, 0.002 * (hi - lo)), hi - lo);
      const start = Math.max(lo, Math.min(hi - size, from.at[0] - (now[0] * size) / width));
      group.zoom(start, start + size);
    });
    const leave = (event) => {
      if (!fingers.delete(event.pointerId)) return;
      if (event.type === "pointerup" && !fingers.size && !moved) {
        if (event.timeStamp - tapped < 350) group.zoom(...group.limits());
        tapped = event.timeStamp;
        group.move(u.posToIdx(place(event)));
      }
      grab();
    };
    ["pointerup", "pointercancel"].forEach((type) => over.addEventListener(type, leave));
  }

  function keyboard(host, group, speak) {
    host.tabIndex = 0;
    host.addEventListener("keydown", (event) => {
      if (event.target !== host || event.ctrlKey || event.metaKey || event.altKey) return;
      const u = group.plots[0].u, n = u.data[0].length, [a, b] = group.window();
      const now = group.at === undefined ? u.valToIdx(0.5 * (a + b)) : group.at;
      const near = Math.max(1, Math.round((u.valToIdx(b) - u.valToIdx(a)) / 360)), far = 20 * near;
      const moves = { ArrowLeft: -near, ArrowRight: near, PageUp: -far, PageDown: far };
      const jumps = { Home: u.valToIdx(a), End: u.valToIdx(b) };
      if (event.key in moves) group.move(Math.max(0, Math.min(n - 1, now + moves[event.key] * (event.shiftKey ? 10 : 1))), speak);
      else if (event.key in jumps) group.move(jumps[event.key], speak);
      else if (event.key === "+" || event.key === "=") group.scale(0.5);
      else if (event.key === "-") group.scale(2);
      else if (event.key === "0") group.zoom(...group.limits());
      else return;
      event.preventDefault();
    });
  }

  function tools(group) {
    if (!group.tools) return;
    const add = (text, label, act) => {
      const button = make("button", "tool", text); button.type = "button";
      if (label) button.setAttribute("aria-label", label);
      button.addEventListener("click", act);
      group.tools.append(button);
    };
    add("Whole revolution", "", () => group.zoom(...group.limits()));
    const spans = group.plots[0].chart.spans;
    for (const span of spans) {
      const margin = 0.06 * (span.b - span.a) + (span.loud ? 4 : 0);
      add(span.l.charAt(0).toUpperCase() + span.l.slice(1), "", () => group.zoom(Math.max(0, span.a - margin), Math.min(360, span.b + margin)));
    }
    add("+", "zoom in", () => group.scale(0.5));
    add("\u2212", "zoom out", () => group.scale(2));
    add("\u25c0", "move left", () => group.shift(-0.25));
    add("\u25b6", "move right", () => group.shift(0.25));
    group.readout = make("span", "readout");
    group.tools.append(group.readout);
    group.tools.hidden = false;
  }

  function build(chart) {
    const figure = document.getElementById("fig-" + chart.id);
    const host = figure && figure.querySelector(".live");
    if (!host) return;
    if (!groups.has(chart.group)) groups.set(chart.group, new Group(chart.group));
    const group = groups.get(chart.group);
    const x = chart.x.d ? Array.from(new Float32Array(bytes(chart.x.d))) : Array.from({ length: chart.x.n }, (_, k) => chart.x.a + chart.x.step * k);
    figure.classList.add("on");
    figure.querySelector(".plot").removeAttribute("tabindex");
    const plots = chart.panels.map((panel, number) => draw(chart, panel, x, number, group, host));
    group.plots.push(...plots);
    host.setAttribute("role", "group");
    host.setAttribute("aria-label", figure.dataset.title + ": curves; arrow keys move the cursor, plus and minus zoom, 0 shows all");
    keyboard(host, group, (index) => chart.label.replace(/ \[.*/, "") + " " + digits(x[index], 360) + unit(chart.label) + ": " + plots.map((plot) => plot.say(index)).filter(Boolean).join("; "));
    new ResizeObserver(() => plots.forEach(({ u }) => { if (host.clientWidth > 60 && Math.abs(u.width - host.clientWidth) > 1) u.setSize({ width: host.clientWidth, height: u.height }); })).observe(host);
  }

  /* On a narrow screen a row of a wide table stands as a block of lines, each with the name of its column. */
  function stacked(table) {
    const heads = [...table.querySelectorAll("thead th")];
    if (heads.length < 4) return;
    table.classList.add("stacked");
    table.setAttribute("role", "table");
    table.querySelectorAll("tr").forEach((row) => {
      row.setAttribute("role", "row");
      [...row.cells].forEach((cell, k) => {
        cell.setAttribute("role", cell.tagName === "TH" ? "columnheader" : "cell");
        if (heads[k]) cell.dataset.label = heads[k].textContent;
      });
    });
  }

  root.classList.add("scripted");
  document.querySelectorAll(".scroll > table").forEach(stacked);
  book.charts.forEach(build);
  groups.forEach(tools);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => groups.forEach((group) => group.plots.forEach(({ u }) => u.redraw(false, true))));
  window.camtorque = { groups };
})();
