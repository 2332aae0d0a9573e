/** The errors of Gauss's and Riemann's rules by the number of points, on a logarithmic scale. */

import type { RayIntegral, RuleCurves } from "../protocol";
import styles from "./quadrature.module.css";

const WIDTH = 340;
const HEIGHT = 120;
const MARGIN = { left: 44, right: 14, top: 8, bottom: 22 };

/** Smaller errors are rounding errors; they are drawn at this size. */
const LEAST = 1e-9;

export function ErrorChart({ ray, n }: { ray: RayIntegral; n: number }) {
  const { gauss, riemann } = ray;
  const size = (error: number): number => Math.log10(Math.max(Math.abs(error), LEAST));
  const all = [...gauss.error, ...riemann.error].map(size);
  const high = Math.ceil(Math.max(...all, -1));
  const low = Math.min(Math.floor(Math.min(...all)), high - 1);
  const [first, last] = [gauss.n[0] ?? 1, gauss.n.at(-1) ?? 6];
  const x = (count: number): number =>
    MARGIN.left + ((WIDTH - MARGIN.left - MARGIN.right) * (count - first)) / Math.max(last - first, 1);
  const y = (power: number): number =>
    MARGIN.top + ((HEIGHT - MARGIN.top - MARGIN.bottom) * (high - power)) / (high - low);
  const line = (rule: RuleCurves): string =>
    rule.n.map((count, i) => `${x(count)},${y(size(rule.error[i] ?? 0))}`).join(" ");
  // Labels at every decade would touch each other when there are many.
  const spacing = Math.ceil((high - low) / 5);
  const decades = Array.from({ length: Math.floor((high - low) / spacing) + 1 }, (_, i) => high - i * spacing);
  return (
    <svg
      className={styles.svg}
      viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
      role="img"
      aria-label="Errors by the number of points, on a logarithmic scale"
    >
      {decades.map((power) => (
        <g key={power}>
          <line className={styles.grid} x1={MARGIN.left} x2={WIDTH - MARGIN.right} y1={y(power)} y2={y(power)} />
          <text className={styles.text} x={MARGIN.left - 6} y={y(power) + 3.5} textAnchor="end">
            1e{power}
          </text>
        </g>
      ))}
      <line className={styles.chosen} x1={x(n)} x2={x(n)} y1={MARGIN.top} y2={HEIGHT - MARGIN.bottom} />
      {gauss.n.map((count) => (
        <text key={count} className={styles.text} x={x(count)} y={HEIGHT - 7} textAnchor="middle">
          {count}
        </text>
      ))}
      <polyline className={styles.riemannLine} points={line(riemann)} />
      <polyline className={styles.gaussLine} points={line(gauss)} />
      {riemann.n.map((count, i) => (
        <rect
          key={count}
          className={styles.riemann}
          x={x(count) - 3}
          y={y(size(riemann.error[i] ?? 0)) - 3}
          width={6}
          height={6}
        />
      ))}
      {gauss.n.map((count, i) => (
        <g key={count} className={styles.gauss}>
          <circle cx={x(count)} cy={y(size(gauss.error[i] ?? 0))} r={3.5} />
        </g>
      ))}
    </svg>
  );
}
