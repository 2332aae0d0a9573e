/** The inspected pixel: its values, the beams in it, and how one of them is integrated. */

import { Button } from "@mantine/core";
import { useEffect } from "react";
import { hex } from "../common/color";
import { format, lastName } from "../common/numbers";
import type { BeamPart } from "../protocol";
import { inspect, picture, session } from "../session/session";
import { useStore } from "../session/store";
import { view } from "../viewport/view";
import { QuadratureDrawing } from "./QuadratureDrawing";
import styles from "./quadrature.module.css";

/** Milliseconds between requests for the same pixel, which cost the server some work. */
const REFRESH = 1000;

/** Ask for the pixel again when the picture has changed. */
function useRefresh(): void {
  useEffect(() => {
    let last = 0;
    let timer: number | undefined;
    const refresh = (): void => {
      timer = undefined;
      last = performance.now();
      inspect(view.get().at);
    };
    const stop = picture.subscribe(() => {
      if (timer !== undefined || session.get().pixel === null) return;
      timer = window.setTimeout(refresh, Math.max(last + REFRESH - performance.now(), 0));
    });
    return () => {
      stop();
      window.clearTimeout(timer);
    };
  }, []);
}

function Layers({ layers }: { layers: Record<string, number[]> }) {
  return (
    <table className={styles.layers}>
      <thead>
        <tr>
          <th scope="col">Layer</th>
          {["R", "G", "B", "A"].map((channel) => (
            <th key={channel} scope="col">
              {channel}
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {Object.entries(layers).map(([name, values]) => (
          <tr key={name}>
            <th scope="row">{name}</th>
            {[0, 1, 2, 3].map((index) => (
              <td key={index}>{values[index] === undefined ? "" : format(values[index], 4)}</td>
            ))}
          </tr>
        ))}
      </tbody>
    </table>
  );
}

function Beams({ beams }: { beams: BeamPart[] }) {
  if (beams.length === 0) return <p className={styles.note}>No beam reaches this pixel.</p>;
  return (
    <ol className={styles.beams}>
      {beams.map((beam, index) => (
        <li key={index} title={beam.light}>
          <span className={styles.swatch} style={{ background: hex(beam.radiance) }} />
          <span className={styles.light}>{lastName(beam.light)}</span>
          <span className={styles.lightGroup}>{beam.group}</span>
          <span className={styles.radiance}>{beam.radiance.map((each) => format(each, 3)).join(" ")}</span>
          <span className={styles.share}>{(100 * beam.fraction).toFixed(1)} %</span>
          <span className={styles.bar} style={{ width: `${Math.min(100 * beam.fraction, 100)}%` }} />
        </li>
      ))}
    </ol>
  );
}

export function PixelPanel() {
  const pixel = useStore(session, (state) => state.pixel);
  const header = useStore(picture, (state) => state.shown?.header);
  useRefresh();
  if (!pixel) {
    return (
      <div className={styles.panel}>
        <p className={styles.note}>
          Choose the Inspect tool and click on the picture, or move the circle with the arrow keys and press Enter.
        </p>
        <Button size="compact-xs" variant="default" onClick={() => view.set({ tool: "inspect" })}>
          Inspect
        </Button>
      </div>
    );
  }
  const [x, y] = pixel.at;
  // A preview has fewer pixels than the full picture.
  const full = (size: number): number => Math.round(size / (header?.scale || 1));
  return (
    <div className={styles.panel}>
      <h2 className={styles.title}>
        Pixel {header && `${Math.floor(x * full(header.width))}, ${Math.floor(y * full(header.height))}`}
        <span className={styles.dim}> linear values</span>
      </h2>
      <Layers layers={pixel.layers} />
      <h2 className={styles.title}>Beams that contribute most</h2>
      <Beams beams={pixel.beams} />
      <h2 className={styles.title}>The quadrature at work</h2>
      {pixel.ray ? (
        <QuadratureDrawing ray={pixel.ray} />
      ) : (
        <p className={styles.note}>No beam is integrated along this pixel's ray.</p>
      )}
    </div>
  );
}
