/** What is shown in the viewport, and the tools that work on it. */

import { ActionIcon, Button, Popover, SegmentedControl, Slider, Switch } from "@mantine/core";
import { useEffect } from "react";
import { Choice } from "../common/Choice";
import { AreaIcon, InspectIcon, MoveIcon, ResetIcon } from "../common/icons";
import { NumberField } from "../common/NumberField";
import { lastName } from "../common/numbers";
import { type Eye, picture, type Shown, session, show } from "../session/session";
import { useStore } from "../session/store";
import { orbitDistance, type Tool, view } from "../viewport/view";
import styles from "./toolbar.module.css";

const TOOLS: { value: Tool; label: string; icon: React.ReactNode }[] = [
  { value: "navigate", label: "Move", icon: <MoveIcon /> },
  { value: "inspect", label: "Inspect", icon: <InspectIcon /> },
  { value: "area", label: "Area", icon: <AreaIcon /> },
];

function Tools() {
  const tool = useStore(view, (state) => state.tool);
  // Side by side, each pixel of the scene is in two places.
  const twice = useStore(session, (state) => state.show.stereo !== null && state.show.eye === "side-by-side");
  useEffect(() => {
    if (twice) view.set({ tool: "navigate" });
  }, [twice]);
  return (
    <div className={styles.group}>
      <SegmentedControl
        size="xs"
        aria-label="Tool"
        value={tool}
        onChange={(value) => view.set({ tool: value as Tool })}
        data={TOOLS.map(({ value, label, icon }) => ({
          value,
          disabled: twice && value !== "navigate",
          label: (
            <span className={styles.tool}>
              {icon} {label}
            </span>
          ),
        }))}
      />
    </div>
  );
}

function CameraChoice() {
  const cameras = useStore(session, (state) => state.scene?.cameras);
  const camera = useStore(session, (state) => state.show.camera);
  return (
    <Choice
      label="Camera"
      className={styles.choice}
      value={camera}
      data={(cameras ?? []).map((path) => ({ value: path, label: lastName(path) }))}
      onChange={(path) => {
        view.set({ distance: null });
        show({ camera: path, pose: null });
      }}
    />
  );
}

/** How the free camera moves. */
function Motion() {
  const speed = useStore(view, (state) => state.speed);
  const distance = useStore(view, (state) => state.distance);
  return (
    <>
      <span>Distance of the pivot</span>
      <NumberField
        label="Distance of the pivot"
        value={distance ?? orbitDistance()}
        min={0.001}
        onChange={(value) => view.set({ distance: value })}
      />
      <span>Speed of flight, ×</span>
      <NumberField
        label="Speed of flight"
        value={speed}
        min={0.01}
        max={100}
        onChange={(value) => view.set({ speed: value })}
      />
    </>
  );
}

function Exposure() {
  const exposure = useStore(session, (state) => state.show.exposure);
  return (
    <div className={styles.exposure}>
      <span className={styles.label}>Exposure</span>
      <Slider
        className={styles.slider}
        size="sm"
        min={-8}
        max={8}
        step={0.1}
        label={null}
        thumbLabel="Exposure in stops"
        value={exposure}
        onChange={(value) => show({ exposure: value })}
      />
      <NumberField
        className={styles.number}
        label="Exposure in stops, exact"
        value={exposure}
        min={-30}
        max={30}
        onChange={(value) => show({ exposure: value })}
      />
      <span className={styles.resetPlace}>
        {exposure !== 0 && (
          <ActionIcon
            size="sm"
            variant="subtle"
            color="gray"
            aria-label="Reset the exposure"
            title="Reset the exposure"
            onClick={() => show({ exposure: 0 })}
          >
            <ResetIcon />
          </ActionIcon>
        )}
      </span>
    </div>
  );
}

function LayerChoice() {
  const layers = useStore(session, (state) => state.scene?.layers ?? NO_NAMES);
  const { layer, other } = useStore(session, (state) => state.show);
  return (
    <Choice
      label="Layer"
      className={styles.choice}
      value={layer}
      data={layers}
      onChange={(name) => show({ layer: name, ...(other === name && { other: null }) })}
    />
  );
}

function DisplayChoice() {
  const displays = useStore(session, (state) => state.scene?.displays ?? NO_NAMES);
  const display = useStore(session, (state) => state.show.display);
  return (
    <Choice label="Display" value={display} data={displays} onChange={(name) => show({ display: name })} />
  );
}

/** Effects that can be turned off, by the names of `Shown`. */
const SWITCHES = [
  { name: "lens", label: "Lens", title: "Depth of field" },
  { name: "blur", label: "Blur", title: "Motion blur" },
  { name: "denoise", label: "Denoise", title: "Denoise pictures with few passes; the finished picture is never denoised" },
] as const;

/** The bounces of the picture, and those that the stage or a room usually has, before the first scene has come. */
const NO_BOUNCES: [number, number] = [0, 0];
const NO_NAMES: string[] = [];

function Switches() {
  const shown = useStore(session, (state) => state.show);
  const [own, most] = useStore(session, (state) => state.scene?.bounces ?? NO_BOUNCES);
  return (
    <div className={styles.switches}>
      {SWITCHES.map(({ name, label, title }) => (
        <Switch
          key={name}
          size="xs"
          label={label}
          title={title}
          checked={shown[name]}
          onChange={(event) => show({ [name]: event.currentTarget.checked } as Partial<Shown>)}
        />
      ))}
      <Switch
        size="xs"
        label="Bounces"
        title={`Light bounces up to ${most} times before it is scattered to the camera`}
        checked={(shown.bounces ?? own) !== 0}
        onChange={(event) => show({ bounces: event.currentTarget.checked ? most : 0 })}
      />
    </div>
  );
}

const EYES: { value: Eye | "one"; label: string }[] = [
  { value: "one", label: "One eye" },
  { value: "anaglyph", label: "Anaglyph" },
  { value: "side-by-side", label: "Side by side" },
  { value: "left", label: "Left eye" },
  { value: "right", label: "Right eye" },
];

/** One eye or two; and the distances of two, unless the stage has a pair of cameras. */
function Eyes() {
  const stereo = useStore(session, (state) => state.show.stereo);
  const eye = useStore(session, (state) => state.show.eye);
  const pair = useStore(session, (state) => state.scene?.pair ?? false);
  const usual = useStore(session, (state) => state.scene?.interaxial ?? 0);
  const [interaxial, convergence] = stereo ?? [null, null];
  return (
    <>
      <span>Eyes</span>
      <Choice
        label="Eyes"
        value={stereo ? eye : "one"}
        data={EYES}
        onChange={(value) => {
          if (value === "one") show({ stereo: null, eye: "left" });
          else show({ stereo: stereo ?? [null, null], eye: value as Eye });
        }}
      />
      {stereo && !pair && (
        <>
          <span>Between the eyes</span>
          <NumberField
            label="Distance between the eyes"
            value={interaxial ?? usual}
            min={0}
            step={usual / 10}
            onChange={(value) => show({ stereo: [value, convergence] })}
          />
          <span>To where they converge</span>
          <NumberField
            label="Distance at which the eyes converge"
            value={convergence}
            none="auto"
            onNone={() => show({ stereo: [interaxial, null] })}
            min={0}
            onChange={(value) => show({ stereo: [interaxial, value || null] })}
          />
        </>
      )}
    </>
  );
}

/** What is left of the wipe line: a kept picture, or another layer of the present one. */
function Compare() {
  const snapshots = useStore(picture, (state) => state.snapshots);
  const layers = useStore(session, (state) => state.scene?.layers ?? NO_NAMES);
  const { layer, other } = useStore(session, (state) => state.show);
  const wipe = useStore(view, (state) => state.wipe);
  const snapshot = snapshots.find((each) => each.id === wipe);
  return (
    <div className={styles.group}>
      <Choice
        label="Compare with"
        className={styles.compare}
        value={other !== null ? `layer ${other}` : String(wipe ?? "")}
        data={[
          { value: "", label: "No comparison" },
          ...layers.filter((name) => name !== layer).map((name) => ({ value: `layer ${name}`, label: `A: ${name}` })),
          ...snapshots.map(({ id, label }) => ({ value: String(id), label: `A: kept ${label}` })),
        ]}
        onChange={(chosen) => {
          const compared = chosen.startsWith("layer ") ? chosen.slice("layer ".length) : null;
          view.set({ wipe: compared === null ? Number(chosen) || null : null });
          if (compared !== other) show({ other: compared });
        }}
      />
      {snapshot ? (
        <Button
          size="compact-xs"
          variant="default"
          aria-label={`Drop ${snapshot.label}`}
          title="Drop this kept picture"
          onClick={() => {
            view.set({ wipe: null });
            picture.drop(snapshot.id);
          }}
        >
          Drop
        </Button>
      ) : (
        <Button
          size="compact-xs"
          variant="default"
          title="Keep the present picture, to compare later ones with it"
          onClick={() => {
            const kept = picture.keep();
            if (kept) view.set({ wipe: kept.id });
            show({ other: null });
          }}
        >
          Keep picture
        </Button>
      )}
    </div>
  );
}

/** What is set rarely: how the picture is shown, which effects it has, and how the free camera moves. */
function ViewMenu() {
  return (
    <Popover trapFocus position="bottom-end" shadow="md" width={300}>
      <Popover.Target>
        <Button size="compact-xs" variant="default" title="Display, effects, eyes, and the free camera">
          View…
        </Button>
      </Popover.Target>
      <Popover.Dropdown className={styles.fields} aria-label="View">
        <span>Display</span>
        <DisplayChoice />
        <Switches />
        <Eyes />
        <Motion />
      </Popover.Dropdown>
    </Popover>
  );
}

export function Toolbar() {
  return (
    <div className={styles.bar} role="group" aria-label="View">
      <Tools />
      <CameraChoice />
      <LayerChoice />
      <Exposure />
      <Compare />
      <ViewMenu />
    </div>
  );
}
