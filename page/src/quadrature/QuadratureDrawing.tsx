/** How a beam's light is integrated along the ray: the integrand, Gauss's points beside Riemann's, and their errors. */

import { SegmentedControl } from "@mantine/core";
import { useState } from "react";
import { format } from "../common/numbers";
import type { RayIntegral, RuleCurves } from "../protocol";
import { ErrorChart } from "./ErrorChart";
import styles from "./quadrature.module.css";

const WIDTH = 340;
const HEIGHT = 150;
const MARGIN = { left: 8, right: 8, top: 10, bottom: 20 };
const TRACK = 12;

/** The lit part of the ray, from the camera at the left to its end. */
function Interval({ ray }: { ray: RayIntegral }) {
  const [a, b] = ray.interval;
  const length = Math.max(ray.length, b, 1e-9);
  const start = Math.max(a, 0);
  const x = (distance: number): number => MARGIN.left + ((WIDTH - MARGIN.left - MARGIN.right) * distance) / length;
  return (
    <svg
      className={styles.svg}
      viewBox={`0 0 ${WIDTH} 34`}
      role="img"
      aria-label={`RayIntegral, ${format(length, 4)} long, in the beam from ${format(a, 4)} to ${format(b, 4)}`}
    >
      <line className={styles.ray} x1={x(0)} x2={x(length)} y1={TRACK} y2={TRACK} />
      <rect className={styles.interval} x={x(start)} width={Math.max(x(b) - x(start), 2)} y={TRACK - 5} height={10} rx={2} />
      <circle className={styles.eye} cx={x(0)} cy={TRACK} r={3.5} />
      <text className={styles.text} x={x(0) - 3} y={31}>
        camera
      </text>
      <text className={styles.text} x={x(length)} y={31} textAnchor="end">
        {format(length, 3)}
      </text>
    </svg>
  );
}

function Integrand({ ray, n }: { ray: RayIntegral; n: number }) {
  const [a, b] = ray.interval;
  const at = (rule: RuleCurves): { points: number[]; values: number[] } => {
    const index = rule.n.indexOf(n);
    return { points: rule.points[index] ?? [], values: rule.values[index] ?? [] };
  };
  const gauss = at(ray.gauss);
  const riemann = at(ray.riemann);
  const most = Math.max(...ray.integrand, ...gauss.values, ...riemann.values, 1e-30) * 1.08;
  const x = (s: number): number => MARGIN.left + ((WIDTH - MARGIN.left - MARGIN.right) * (s - a)) / (b - a || 1);
  const y = (value: number): number => HEIGHT - MARGIN.bottom - ((HEIGHT - MARGIN.top - MARGIN.bottom) * value) / most;
  const curve = ray.s.map((s, i) => `${x(s).toFixed(1)},${y(ray.integrand[i] ?? 0).toFixed(1)}`).join(" ");
  const step = (b - a) / Math.max(riemann.points.length, 1);
  return (
    <svg
      className={styles.svg}
      viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
      role="img"
      aria-label={`Integrand along the ray with the ${n} points of Gauss–Legendre and of Riemann`}
    >
      {riemann.points.map((s, i) => (
        <rect
          key={i}
          className={styles.column}
          x={x(s - step / 2)}
          width={Math.max(x(s + step / 2) - x(s - step / 2), 0)}
          y={y(riemann.values[i] ?? 0)}
          height={y(0) - y(riemann.values[i] ?? 0)}
        />
      ))}
      <polygon className={styles.area} points={`${x(a)},${y(0)} ${curve} ${x(b)},${y(0)}`} />
      <polyline className={styles.curve} points={curve} />
      <line className={styles.axis} x1={x(a)} x2={x(b)} y1={y(0)} y2={y(0)} />
      {riemann.points.map((s, i) => (
        <rect
          key={i}
          className={styles.riemann}
          x={x(s) - 4}
          y={y(riemann.values[i] ?? 0) - 4}
          width={8}
          height={8}
        />
      ))}
      {gauss.points.map((s, i) => (
        <g key={i} className={styles.gauss}>
          <line x1={x(s)} x2={x(s)} y1={y(0)} y2={y(gauss.values[i] ?? 0)} />
          <circle cx={x(s)} cy={y(gauss.values[i] ?? 0)} r={4.5} />
        </g>
      ))}
      <text className={styles.text} x={x(a)} y={HEIGHT - 5}>
        {format(a, 3)}
      </text>
      <text className={styles.text} x={x(b)} y={HEIGHT - 5} textAnchor="end">
        {format(b, 3)}
      </text>
    </svg>
  );
}

/** The size of an error as text. */
function inWords(rule: RuleCurves, n: number): string {
  const error = rule.error[rule.n.indexOf(n)];
  return error === undefined ? "unknown" : error === 0 ? "0" : Math.abs(error).toExponential(1);
}

export function QuadratureDrawing({ ray }: { ray: RayIntegral }) {
  const [n, setN] = useState(2);
  const sizes = ray.gauss.n;
  const chosen = sizes.includes(n) ? n : (sizes[0] ?? 1);
  return (
    <div className={styles.drawing}>
      <p className={styles.note}>
        Estimator {ray.estimator}; the beam's radius is {format(ray.radius[0], 3)} to {format(ray.radius[1], 3)}.
      </p>
      <Interval ray={ray} />
      <div className={styles.choice}>
        <span>Points</span>
        <SegmentedControl
          size="xs"
          aria-label="Number of points"
          value={String(chosen)}
          onChange={(value) => setN(Number(value))}
          data={sizes.map(String)}
        />
      </div>
      <Integrand ray={ray} n={chosen} />
      <dl className={styles.legend}>
        <dt>
          <span className={styles.gaussMark} /> Gauss–Legendre
        </dt>
        <dd>error {inWords(ray.gauss, chosen)}</dd>
        <dt>
          <span className={styles.riemannMark} /> Riemann
        </dt>
        <dd>error {inWords(ray.riemann, chosen)}</dd>
      </dl>
      <ErrorChart ray={ray} n={chosen} />
    </div>
  );
}
