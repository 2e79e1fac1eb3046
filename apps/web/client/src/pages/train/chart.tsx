// Curves as SVG, with their last values as text.
import { useId } from 'preact/hooks';
import { cellText } from '../../format';
import { Table } from '../../ui';
import { polyline, type Series } from './curves';

const width = 600;
const height = 180;

export function Chart(props: { title: string; series: Series[]; x: string; y: string }) {
  const id = useId();
  const shown = props.series.slice(0, 6);
  const xs = shown.flatMap((one) => one.x);
  const ys = shown.flatMap((one) => one.y);
  if (xs.length === 0) return null;
  const x0 = Math.min(...xs);
  const x1 = Math.max(...xs);
  const low = Math.min(0, ...ys);
  const high = Math.max(...ys);
  return (
    <figure class="chart">
      <figcaption id={id}>{props.title}</figcaption>
      <svg viewBox={`-44 -8 ${width + 56} ${height + 34}`} role="img" aria-labelledby={id}>
        <line class="axis" x1={0} y1={height} x2={width} y2={height} />
        <line class="axis" x1={0} y1={0} x2={0} y2={height} />
        <text class="tick" x={-4} y={6} text-anchor="end">
          {cellText(high)}
        </text>
        <text class="tick" x={-4} y={height} text-anchor="end">
          {cellText(low)}
        </text>
        <text class="tick" x={0} y={height + 16}>
          {cellText(x0)}
        </text>
        <text class="tick" x={width} y={height + 16} text-anchor="end">
          {cellText(x1)} {props.x}
        </text>
        {shown.map((one, i) => (
          <polyline
            key={one.name}
            class={`curve curve-${i}`}
            points={polyline(one, width, height, low, high, x0, x1)}
          />
        ))}
      </svg>
      <Table
        caption={`${props.title}: last values`}
        hideCaption
        columns={[
          {
            name: 'Curve',
            show: (one) => (
              <span class="legend">
                <svg viewBox="0 0 24 8" aria-hidden="true">
                  <line class={`curve curve-${shown.indexOf(one)}`} x1={0} y1={4} x2={24} y2={4} />
                </svg>
                {one.name}
              </span>
            ),
          },
          { name: props.y, show: (one) => cellText(one.y[one.y.length - 1]), number: true },
        ]}
        rows={shown}
        keyOf={(one) => one.name}
      />
    </figure>
  );
}
