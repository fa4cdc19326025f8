'use strict';
// Plots of the report: read a value by pointing, zoom by a drag, back by a double click, a series off and on by its name.
// The page is complete without this.
for (const figure of document.querySelectorAll('figure[data-plot]')) {
  const plot = JSON.parse(figure.dataset.plot), svg = figure.querySelector('svg'), link = figure.querySelector('a[download]');
  const [left, top, width, height] = plot.box, space = svg.namespaceURI;
  const at = ([low, high], value) => (value - low) / (high - low);
  let view = { x: plot.x, y: plot.y }, rows = null, drag = null;
  const hidden = new Set(), plain = svg.innerHTML;

  const make = (name, attributes, parent = svg) => {
    const element = document.createElementNS(space, name);
    for (const key in attributes) element.setAttribute(key, attributes[key]);
    parent.appendChild(element);
    return element;
  };
  // The link's table: series, x, y and, where there are bars, their half-lengths, in the axes' units.
  const data = () => {
    if (rows) return rows;
    const text = new TextDecoder().decode(Uint8Array.from(atob(link.href.split(',')[1]), (c) => c.charCodeAt(0)));
    rows = plot.names.map(() => []);
    for (const line of text.split('\n').slice(1)) {
      const [series, x, y, spread] = line.split(',');
      if (y === undefined) continue;
      const take = (log, value) => (log ? (Number(value) > 0 ? Math.log10(Number(value)) : NaN) : value === '' ? NaN : Number(value));
      rows[series]?.push([take(plot.log[0], x), take(plot.log[1], y), Number(spread) || 0]);
    }
    return rows;
  };
  const px = (x) => left + at(view.x, x) * width, py = (y) => top + height - at(view.y, y) * height;
  const place = (event) => {
    const box = svg.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * plot.size[0], ((event.clientY - box.top) / box.height) * plot.size[1]];
  };
  const inside = ([x, y]) => x >= left && x <= left + width && y >= top && y <= top + height;
  const value = ([x, y]) => [view.x[0] + ((x - left) / width) * (view.x[1] - view.x[0]), view.y[0] + ((top + height - y) / height) * (view.y[1] - view.y[0])];
  const shown = (number, log) => {
    const linear = log ? 10 ** number : number;
    return (linear === 0 ? '0' : Math.abs(linear) >= 1e5 || Math.abs(linear) < 1e-3 ? linear.toExponential(2) : String(+linear.toPrecision(4))).replace('-', '\u2212');
  };
  const step = ([low, high], wanted) => {
    const raw = (high - low) / wanted, ten = 10 ** Math.floor(Math.log10(raw));
    return [1, 2, 5, 10].find((k) => k * ten >= raw * 0.999999) * ten;
  };
  const listen = () => {
    svg.querySelectorAll('[data-key]').forEach((key) => {
      key.style.cursor = 'pointer';
      key.onclick = () => {
        const name = key.dataset.key;
        hidden.has(name) ? hidden.delete(name) : hidden.add(name);
        dim();
      };
    });
    dim();
  };
  const dim = () => {
    svg.querySelectorAll('[data-key]').forEach((key) => (key.style.opacity = hidden.has(key.dataset.key) ? 0.35 : 1));
    svg.querySelectorAll('[data-series]').forEach((one) => (one.style.display = hidden.has(one.dataset.series) ? 'none' : ''));
  };

  // Zoomed in all points are drawn, whatever the page had thinned, and the ticks are new.
  const draw = () => {
    svg.innerHTML = plain;
    if (view.x !== plot.x || view.y !== plot.y) redraw();
    listen();
  };
  const redraw = () => {
    svg.querySelectorAll('[data-series],[data-fixed]').forEach((one) => one.remove());
    const id = `clip${[...document.querySelectorAll('figure')].indexOf(figure)}`;
    make('rect', { x: left, y: top, width, height }, make('clipPath', { id }, make('defs', {})));
    [['x', 0, width / 70], ['y', 1, height / 36]].forEach(([axis, k, wanted]) => {
      const by = step(view[axis], wanted);
      for (let i = Math.ceil(view[axis][0] / by); i * by <= view[axis][1] * (1 + 1e-12); ++i) {
        const p = k ? py(i * by) : px(i * by);
        make('path', { d: k ? `M${left} ${p}h${width}` : `M${p} ${top}v${height}`, stroke: '#E7EAED' });
        make('text', k ? { x: left - 7, y: p + 4, 'text-anchor': 'end', 'font-size': 11, fill: '#59626B' } : { x: p, y: top + height + 17, 'text-anchor': 'middle', 'font-size': 11, fill: '#59626B' })
          .textContent = shown(i * by, plot.log[k]);
      }
    });
    for (const [low, high, label] of plot.expected) {
      const a = py(high ?? view.y[1]), b = py(low ?? view.y[0]), group = make('g', { 'clip-path': `url(#${id})` });
      make('rect', { x: left, y: a, width, height: Math.max(0, b - a), fill: '#E9DFCB', 'fill-opacity': 0.6 }, group);
      make('path', { d: `M${left} ${a}h${width}M${left} ${b}h${width}`, stroke: '#8F5A00', 'stroke-dasharray': '6 4' }, group);
      make('text', { x: left + width - 5, y: a - 5, 'text-anchor': 'end', 'font-size': 11, 'font-weight': 600, fill: '#8F5A00' }, group).textContent = label;
    }
    data().forEach((points, i) => {
      const pen = plot.pens[i], group = make('g', { 'data-series': i, 'clip-path': `url(#${id})`, fill: 'none', stroke: pen.color, 'stroke-width': pen.points ? 1.2 : 1.6 });
      let line = '', up = true, bars = '';
      for (const [x, y, spread] of points) {
        if (!Number.isFinite(x) || !Number.isFinite(y)) { up = true; continue; }
        if (spread) bars += `M${px(x)} ${py(y - spread)}V${py(y + spread)}`;
        if (pen.points) { if (x >= view.x[0] && x <= view.x[1]) make('circle', { cx: px(x), cy: py(y), r: 2.6 }, group); continue; }
        line += `${up ? 'M' : 'L'}${px(x).toFixed(1)} ${py(y).toFixed(1)}`;
        up = false;
      }
      if (line) make('path', { d: line, 'stroke-dasharray': pen.dashes || 'none' }, group);
      if (bars) make('path', { d: bars }, group);
    });
    make('rect', { x: left, y: top, width, height, fill: 'none', stroke: '#7D868F' });
  };

  const box = document.createElement('div');
  box.className = 'reading';
  box.hidden = true;
  figure.appendChild(box);
  const clear = () => { svg.querySelectorAll('[data-hover]').forEach((one) => one.remove()); box.hidden = true; };
  const read = (spot) => {
    clear();
    const [x, y] = value(spot), marks = [];
    let best = null;
    data().forEach((points, i) => {
      if (hidden.has(String(i)) || !plot.names[i]) return;
      let near = null;
      for (const point of points) {
        if (!Number.isFinite(point[0]) || !Number.isFinite(point[1])) continue;
        // A path comes back to an x: there the distance in the plane counts.
        const away = plot.equal ? Math.hypot(point[0] - x, point[1] - y) : Math.abs(point[0] - x);
        if (!near || away < near.away) near = { away, point, i };
      }
      if (near) marks.push(near);
      if (near && (!best || near.away < best.away)) best = near;
    });
    if (!best) return;
    if (!plot.equal) make('path', { 'data-hover': '', d: `M${px(best.point[0])} ${top}v${height}`, stroke: '#1F252B' });
    box.textContent = '';
    const line = (text, color, number) => {
      const row = document.createElement('p'), name = document.createElement('span'), figureText = document.createElement('b');
      name.textContent = text, name.style.color = color, figureText.textContent = number;
      row.append(name, figureText), box.append(row);
    };
    line(plot.labels[0], '', shown(best.point[0], plot.log[0]));
    for (const { point, i } of marks) {
      if (!plot.equal && Math.abs(px(point[0]) - px(best.point[0])) > 12) continue;
      line(plot.names[i], plot.pens[i].color, (plot.equal ? `${shown(point[0])}, ` : '') + shown(point[1], plot.log[1]) + (point[2] ? ` \u00b1 ${shown(point[2])}` : ''));
      make('circle', { 'data-hover': '', cx: px(point[0]), cy: py(point[1]), r: 4, fill: '#fff', stroke: plot.pens[i].color, 'stroke-width': 2 });
    }
    box.hidden = false;
    const scale = svg.getBoundingClientRect().width / plot.size[0], late = px(best.point[0]) > left + width / 2;
    box.style.left = late ? '' : `${px(best.point[0]) * scale + 12}px`;
    box.style.right = late ? `${(plot.size[0] - px(best.point[0])) * scale + 12}px` : '';
    box.style.top = `${(top + 6) * scale}px`;
  };

  svg.addEventListener('pointermove', (event) => {
    const spot = place(event);
    if (drag) {
      drag.to = spot;
      clear();
      const [a, b] = [drag.from, spot];
      make('rect', { 'data-hover': '', x: Math.min(a[0], b[0]), y: Math.min(a[1], b[1]), width: Math.abs(a[0] - b[0]), height: Math.abs(a[1] - b[1]), fill: '#0072B2', 'fill-opacity': 0.12, stroke: '#0072B2' });
    } else if (inside(spot)) read(spot);
    else clear();
  });
  svg.addEventListener('pointerdown', (event) => {
    const spot = place(event);
    if (event.button !== 0 || !inside(spot)) return;
    drag = { from: spot, to: spot };
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener('pointerup', () => {
    const done = drag;
    drag = null;
    clear();
    if (!done || Math.abs(done.from[0] - done.to[0]) < 6) return;
    const [a, b] = [value(done.from), value(done.to)], flat = Math.abs(done.from[1] - done.to[1]) < 12;
    view = { x: [Math.min(a[0], b[0]), Math.max(a[0], b[0])], y: flat ? view.y : [Math.min(a[1], b[1]), Math.max(a[1], b[1])] };
    draw();
  });
  svg.addEventListener('dblclick', () => { view = { x: plot.x, y: plot.y }; draw(); });
  svg.addEventListener('pointerleave', () => drag || clear());
  figure.querySelector('.how').hidden = false;
  listen();
}
