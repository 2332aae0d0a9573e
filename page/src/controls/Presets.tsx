/** Presets with their thumbnails, for a look, for one of its factors, or for a new look of a light. */

import { Button, Popover } from "@mantine/core";
import { useState } from "react";
import { token } from "../session/connection";
import { applyPreset, session } from "../session/session";
import { useStore } from "../session/store";
import styles from "./controls.module.css";

interface PresetsProps {
  /** "look" for whole looks, else a factor. */
  factor: string;
  /** The look or the light that the preset is applied to. */
  path: string;
  /** What the button says, and for whom: "New look", "of Key". */
  text: string;
  whose: string;
  /** Whether the list stays open, so that another preset can be tried. */
  stays?: boolean;
}

export function Presets({ factor, path, text, whose, stays = false }: PresetsProps) {
  const presets = useStore(session, (state) => state.scene?.presets);
  const [opened, setOpened] = useState(false);
  const own = (presets ?? []).filter((preset) => preset.factor === factor);
  if (own.length === 0) return null;
  return (
    <Popover
      trapFocus
      withinPortal
      position="bottom-end"
      shadow="md"
      width={328}
      opened={opened}
      onChange={setOpened}
    >
      <Popover.Target>
        <Button
          size="compact-xs"
          variant="default"
          aria-label={`${text} ${whose}`}
          onClick={() => setOpened((before) => !before)}
        >
          {text}
        </Button>
      </Popover.Target>
      <Popover.Dropdown className={styles.presets} aria-label={`${text} ${whose}`}>
        {own.map(({ name, label }) => (
          <button
            key={name}
            type="button"
            className={styles.preset}
            onClick={() => {
              applyPreset(name, path);
              if (!stays) setOpened(false);
            }}
          >
            {/* Decoration: the name is beside it. */}
            <img
              src={`presets/${name}.png?token=${encodeURIComponent(token())}`}
              alt=""
              width={144}
              height={60}
              loading="lazy"
            />
            {label}
          </button>
        ))}
      </Popover.Dropdown>
    </Popover>
  );
}
