// One plot over the last minute of the experiment.
import { useEffect, useRef } from 'preact/hooks';
import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';

const kSpan = 60; // s

export function Plot({ title, unit, series, rows }) {
  const place = useRef(null), plot = useRef(null);
  useEffect(() => {
    const axis = { stroke: '#aeb8c4', grid: { stroke: '#232c35' }, ticks: { stroke: '#232c35' } };
    plot.current = new uPlot(
      {
        width: place.current.clientWidth || 360,
        height: 170,
        legend: { show: false },
        cursor: { show: false },
        scales: { x: { time: false } },
        axes: [{ ...axis, size: 30 }, { ...axis, size: 52 }],
        series: [{}, ...series.map(({ color, dash }) => ({ stroke: color, width: 1.5, dash, spanGaps: false }))],
      },
      [[], ...series.map(() => [])],
      place.current,
    );
    const fit = new ResizeObserver(() => plot.current.setSize({ width: place.current.clientWidth, height: 170 }));
    fit.observe(place.current);
    return () => (fit.disconnect(), plot.current.destroy());
  }, []);
  useEffect(() => {
    const last = rows.length ? rows[rows.length - 1].t : 0;
    const kept = rows.filter((row) => row.t > last - kSpan);
    plot.current.setData([kept.map((r) => r.t), ...series.map(({ of }) => kept.map((r) => of(r)))]);
  });
  return (
    <section class="plot">
      <h2>
        {title} <span class="quiet">{unit}, last {kSpan} s</span>
        {series.map(({ name, color }) => <span class="key"><i style={{ background: color }} />{name}</span>)}
      </h2>
      <div ref={place} />
    </section>
  );
}
