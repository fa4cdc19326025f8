// Tools of the eye's picture, and the panel of its light: histogram, black and white level of the display.
import { useEffect, useState } from 'preact/hooks';

const kIcons = {
  aim: 'M12 3v5M12 16v5M3 12h5M16 12h5M12 7a5 5 0 1 0 0 10 5 5 0 0 0 0-10',
  pan: 'M12 3v18M3 12h18M9 6l3-3 3 3M9 18l3 3 3-3M6 9l-3 3 3 3M18 9l3 3-3 3',
  measure: 'M3 16L16 3l5 5L8 21zM8 11l2 2M11 8l3 3M14 5l2 2',
  mark: 'M6 21V4l13 4-13 5',
  plus: 'M10.5 4a6.5 6.5 0 1 0 0 13 6.5 6.5 0 0 0 0-13M15.5 15.5L21 21M10.5 7.5v6M7.5 10.5h6',
  minus: 'M10.5 4a6.5 6.5 0 1 0 0 13 6.5 6.5 0 0 0 0-13M15.5 15.5L21 21M7.5 10.5h6',
  fit: 'M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5',
  contrast: 'M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18v18',
  hold: 'M3 12c3-5 6-7 9-7s6 2 9 7c-3 5-6 7-9 7s-6-2-9-7M9 9v6h6V9zM10 9V7.5a2 2 0 0 1 4 0V9',
  snapshot: 'M4 8h4l2-3h4l2 3h4v11H4zM12 10a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7',
};

function Button({ icon, title, pressed, onClick, wide }) {
  return (
    <button type="button" title={title} aria-label={title} aria-pressed={pressed} class={wide ? 'wide-only' : ''} onClick={onClick} data-tool={icon}>
      <svg viewBox="0 0 24 24" aria-hidden="true"><path d={kIcons[icon]} /></svg>
    </button>
  );
}

const kTools = [['aim', 'target or path (T)'], ['pan', 'pan (H)', true], ['measure', 'measure (M)'], ['mark', 'flag (F)', true]];

/** `hold`: whether the retina is held still; null where it is not followed. */
export function Tools({ tool, setTool, acts, look, hold }) {
  return (
    <div class="tools" role="toolbar" aria-label="tools">
      {kTools.map(([name, title, wide]) => <Button icon={name} title={title} wide={wide} pressed={tool === name} onClick={() => setTool(name)} />)}
      <hr />
      <Button icon="plus" title="zoom in (+)" onClick={() => acts.zoom(1.5)} />
      <Button icon="minus" title="zoom out (−)" wide onClick={() => acts.zoom(1 / 1.5)} />
      <Button icon="fit" title="whole picture (0)" wide onClick={() => (acts.zoom(0), acts.clear())} />
      <Button icon="contrast" title="contrast (C)" wide pressed={look.open} onClick={acts.contrast} />
      {hold === null ? null : <Button icon="hold" title={hold ? 'let the retina move (R)' : 'hold the retina still (R)'} pressed={hold} onClick={acts.hold} />}
      <hr />
      <Button icon="snapshot" title="snapshot (S)" onClick={acts.snapshot} />
    </div>
  );
}

const kBins = 64;

/** Shares of the gray levels, and the levels below which 0.5 % and 99.5 % of the pixels lie. */
function histogramOf(frame) {
  const width = 160, height = Math.max(1, Math.round((160 * frame.height) / frame.width));
  const sheet = new OffscreenCanvas(width, height), pen = sheet.getContext('2d', { willReadFrequently: true });
  pen.drawImage(frame.bitmap, 0, 0, width, height);
  const { data } = pen.getImageData(0, 0, width, height), counts = new Array(256).fill(0), bins = new Array(kBins).fill(0);
  for (let i = 0; i < data.length; i += 4) {
    const gray = Math.round(0.299 * data[i] + 0.587 * data[i + 1] + 0.114 * data[i + 2]);
    counts[gray] += 1;
    bins[Math.floor((gray * kBins) / 256)] += 1;
  }
  const total = width * height, edge = (share) => {
    let sum = 0, level = 0;
    while (level < 255 && (sum += counts[level]) < share * total) ++level;
    return level;
  };
  return { bins, low: edge(0.005), high: edge(0.995), clipped: counts[255] / total };
}

export function LightPanel({ look, setLook, frame }) {
  const [shape, setShape] = useState(null);
  useEffect(() => setShape(histogramOf(frame)), [Math.floor(frame.arrived / 500)]);
  if (!shape) return null;
  const most = Math.max(...shape.bins), step = 256 / kBins;
  const set = (part) => (event) => {
    const value = Number(event.target.value);
    setLook({ ...look, [part]: part === 'low' ? Math.min(value, look.high - 4) : Math.max(value, look.low + 4) });
  };
  return (
    <div class="light-panel" id="light-panel">
      <b>Contrast <span class="quiet">of the display only</span></b>
      <svg viewBox="0 0 256 64" preserveAspectRatio="none" role="img" aria-label="histogram of gray levels">
        {shape.bins.map((count, i) => <rect x={i * step} width={step} y={64 - (60 * count) / most} height={(60 * count) / most} fill="#56b4e9" />)}
        <path d={`M${look.low} 0V64M${look.high} 0V64`} stroke="#fff" vector-effect="non-scaling-stroke" />
      </svg>
      <label>black <input type="range" min="0" max="255" value={look.low} onInput={set('low')} />{look.low}</label>
      <label>white <input type="range" min="0" max="255" value={look.high} onInput={set('high')} />{look.high}</label>
      <div style={{ display: 'flex', gap: '.4rem' }}>
        <button onClick={() => setLook({ ...look, low: shape.low, high: Math.max(shape.high, shape.low + 4) })}>Fit</button>
        <button onClick={() => setLook({ ...look, low: 0, high: 255 })}>As it is</button>
      </div>
      <span class={shape.clipped > 0.01 ? '' : 'quiet'}>{(shape.clipped * 100).toFixed(1)} % saturated</span>
    </div>
  );
}
