/** All keys, and what the pointer does. */

import { Kbd, Modal } from "@mantine/core";
import styles from "./keep.module.css";

const KEYS: { title: string; keys: [keys: string[], action: string][] }[] = [
  {
    title: "Picture (when it has the focus)",
    keys: [
      [["W", "A", "S", "D"], "fly; faster with Shift"],
      [["Q", "E"], "down, up"],
      [["←", "→", "↑", "↓"], "turn; move the rectangle or the inspected pixel"],
      [["Shift", "←"], "with the area tool: change the rectangle's size"],
      [["Enter"], "inspect the pixel; begin a rectangle"],
      [["Esc"], "back to moving the camera"],
    ],
  },
  {
    title: "Pointer on the picture",
    keys: [
      [["Drag"], "orbit the point in front of the camera"],
      [["Shift", "Drag"], "pan; so does the middle button"],
      [["Wheel"], "nearer, farther"],
    ],
  },
  {
    title: "Fields and ramps",
    keys: [
      [["↑", "↓"], "step a number; ten times as far with Shift"],
      [["Enter"], "confirm what was typed"],
      [["←", "→"], "move a ramp's key"],
      [["↑", "↓"], "change the value of a curve's knot"],
      [["Del"], "delete a ramp's key"],
    ],
  },
  {
    title: "Everywhere",
    keys: [
      [["Ctrl", "Z"], "undo"],
      [["Ctrl", "Shift", "Z"], "redo; so does Ctrl Y"],
      [["Ctrl", "S"], "save"],
      [["?"], "these keys"],
    ],
  },
];

export function HelpDialog({ opened, onClose }: { opened: boolean; onClose: () => void }) {
  return (
    <Modal opened={opened} onClose={onClose} title="Keys" size="lg" centered>
      <div className={styles.help}>
        {KEYS.map(({ title, keys }) => (
          <section key={title}>
            <h3 className={styles.helpTitle}>{title}</h3>
            <dl className={styles.keys}>
              {keys.map(([pressed, action]) => (
                <div key={pressed.join() + action}>
                  <dt>
                    {pressed.map((key) => (
                      <Kbd key={key} size="xs">
                        {key}
                      </Kbd>
                    ))}
                  </dt>
                  <dd>{action}</dd>
                </div>
              ))}
            </dl>
          </section>
        ))}
      </div>
    </Modal>
  );
}
