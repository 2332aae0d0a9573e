/** What is shown in the viewport, and the tools that work on it. */

import { ActionIcon, Button, NativeSelect, Popover, SegmentedControl, Slider, Switch } from "@mantine/core";
import { AreaIcon, CameraIcon, CloseIcon, InspectIcon, MoveIcon, ResetIcon } from "../common/icons";
import { NumberField } from "../common/NumberField";
import { lastName } from "../common/numbers";
import { picture, session, show } from "../session/session";
import { useStore } from "../session/store";
import { orbitDistance, throughTheCamera, type Tool, view } from "../viewport/view";
import styles from "./toolbar.module.css";

const TOOLS: { value: Tool; label: string; icon: React.ReactNode }[] = [
  { value: "navigate", label: "Move", icon: <MoveIcon /> },
  { value: "inspect", label: "Inspect", icon: <InspectIcon /> },
  { value: "area", label: "Area", icon: <AreaIcon /> },
];

function Tools() {
  const tool = useStore(view, (state) => state.tool);
  const area = useStore(session, (state) => state.show.area);
  return (
    <div className={styles.group}>
      <SegmentedControl
        size="xs"
        aria-label="Tool"
        value={tool}
        onChange={(value) => view.set({ tool: value as Tool })}
        data={TOOLS.map(({ value, label, icon }) => ({
          value,
          label: (
            <span className={styles.tool}>
              {icon} {label}
            </span>
          ),
        }))}
      />
      {area && (
        <Button size="compact-xs" variant="light" leftSection={<CloseIcon />} onClick={() => show({ area: null })}>
          Clear area
        </Button>
      )}
    </div>
  );
}

function CameraChoice() {
  const cameras = useStore(session, (state) => state.scene?.cameras);
  const camera = useStore(session, (state) => state.show.camera);
  const free = useStore(session, (state) => state.show.pose !== null);
  const speed = useStore(view, (state) => state.speed);
  const distance = useStore(view, (state) => state.distance);
  return (
    <div className={styles.group}>
      <NativeSelect
        size="xs"
        aria-label="Camera"
        title="Camera"
        className={styles.camera}
        value={camera}
        data={(cameras ?? []).map((path) => ({ value: path, label: lastName(path) }))}
        onChange={(event) => {
          view.set({ distance: null });
          show({ camera: event.currentTarget.value, pose: null });
        }}
      />
      <Button
        size="compact-xs"
        variant={free ? "filled" : "default"}
        disabled={!free}
        leftSection={<CameraIcon />}
        title="Leave the free view and look through the shot's camera"
        onClick={throughTheCamera}
      >
        Through the camera
      </Button>
      <Popover trapFocus position="bottom-start" shadow="md" width={240}>
        <Popover.Target>
          <Button size="compact-xs" variant="default" title="How the free camera moves">
            Motion
          </Button>
        </Popover.Target>
        <Popover.Dropdown className={styles.fields} aria-label="How the free camera moves">
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
        </Popover.Dropdown>
      </Popover>
    </div>
  );
}

function Exposure() {
  const exposure = useStore(session, (state) => state.show.exposure);
  return (
    <div className={styles.group}>
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
      <ActionIcon
        size="sm"
        variant="subtle"
        color="gray"
        aria-label="Reset the exposure"
        title="Reset the exposure"
        disabled={exposure === 0}
        onClick={() => show({ exposure: 0 })}
      >
        <ResetIcon />
      </ActionIcon>
    </div>
  );
}

function LayerAndDisplay() {
  const scene = useStore(session, (state) => state.scene);
  const layer = useStore(session, (state) => state.show.layer);
  const display = useStore(session, (state) => state.show.display);
  return (
    <div className={styles.group}>
      <NativeSelect
        size="xs"
        aria-label="Layer"
        title="Layer"
        className={styles.choice}
        value={layer}
        data={scene?.layers ?? []}
        onChange={(event) => show({ layer: event.currentTarget.value })}
      />
      <NativeSelect
        size="xs"
        aria-label="Display"
        title="Display"
        className={styles.choice}
        value={display}
        data={scene?.displays ?? []}
        onChange={(event) => show({ display: event.currentTarget.value })}
      />
    </div>
  );
}

function Lens() {
  const lens = useStore(session, (state) => state.show.lens);
  const blur = useStore(session, (state) => state.show.blur);
  return (
    <div className={styles.switches}>
      <Switch
        size="xs"
        label="Lens"
        title="Depth of field and what else the lens does"
        checked={lens}
        onChange={(event) => show({ lens: event.currentTarget.checked })}
      />
      <Switch
        size="xs"
        label="Blur"
        title="Motion blur"
        checked={blur}
        onChange={(event) => show({ blur: event.currentTarget.checked })}
      />
    </div>
  );
}

function Compare() {
  const snapshots = useStore(picture, (state) => state.snapshots);
  const wipe = useStore(view, (state) => state.wipe);
  const snapshot = snapshots.find((each) => each.id === wipe);
  return (
    <div className={styles.group}>
      <Button
        size="compact-xs"
        variant="default"
        title="Keep the present picture, to compare later ones with it"
        onClick={() => {
          const kept = picture.keep();
          if (kept) view.set({ wipe: kept.id });
        }}
      >
        Keep picture
      </Button>
      {snapshots.length > 0 && (
        <NativeSelect
          size="xs"
          aria-label="Compare with"
          title="Compare with"
          className={styles.compare}
          value={wipe ?? ""}
          data={[
            { value: "", label: "No comparison" },
            ...snapshots.map(({ id, label }) => ({ value: String(id), label: `A: ${label}` })),
          ]}
          onChange={(event) => view.set({ wipe: Number(event.currentTarget.value) || null })}
        />
      )}
      {snapshot && (
        <ActionIcon
          size="sm"
          variant="subtle"
          color="gray"
          aria-label={`Drop ${snapshot.label}`}
          title="Drop this kept picture"
          onClick={() => {
            view.set({ wipe: null });
            picture.drop(snapshot.id);
          }}
        >
          <CloseIcon />
        </ActionIcon>
      )}
    </div>
  );
}

/** The solo buttons are beside the lights; here it shows that a part of the light is missing. */
function Solo() {
  const solo = useStore(session, (state) => state.show.solo);
  if (solo.length === 0) return null;
  return (
    <Button
      size="compact-xs"
      variant="light"
      color="yellow"
      rightSection={<CloseIcon />}
      title="Show all lights again"
      onClick={() => show({ solo: [] })}
    >
      Solo: {solo.length} {solo.length === 1 ? "light" : "lights"}
    </Button>
  );
}

export function Toolbar() {
  return (
    <div className={styles.bar} role="group" aria-label="View">
      <Tools />
      <CameraChoice />
      <LayerAndDisplay />
      <Exposure />
      <Lens />
      <Compare />
      <Solo />
    </div>
  );
}
