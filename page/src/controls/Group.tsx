/** One light, medium or look: its name, its switches, and its controls in sections. */

import { ActionIcon, Button, Switch } from "@mantine/core";
import { memo } from "react";
import { ChevronIcon, SoloIcon, WarningIcon } from "../common/icons";
import { lastName } from "../common/numbers";
import type { ControlItem, ControlGroup } from "../protocol";
import { keepLook, session, setValues, show } from "../session/session";
import { useStore } from "../session/store";
import { hasEffect, useValue } from "./attribute";
import { ControlRow } from "./ControlRow";
import styles from "./controls.module.css";
import { Presets } from "./Presets";
import { goToGroup, groupId, panel, toggleGroup, toggleSection } from "./panel";

/** The control that turns a light off: its visibility, or a switch of its own. */
function onOffControl(group: ControlGroup): ControlItem | undefined {
  return group.controls.find(
    ({ path, kind }) =>
      /\.visibility$/.test(path) || (kind === "bool" && /[.:](on|enabled?|enabledLight)$/i.test(path)),
  );
}

function OnOff({ group, control }: { group: ControlGroup; control: ControlItem }) {
  const value = useValue(control.path);
  const on = value === true || (value !== false && value !== "invisible");
  return (
    <Switch
      size="xs"
      aria-label={`${group.label} on`}
      title={on ? "Turn off" : "Turn on"}
      checked={on}
      onChange={(event) => {
        const next = event.currentTarget.checked;
        setValues({ [control.path]: control.kind === "bool" ? next : next ? "inherited" : "invisible" });
      }}
    />
  );
}

function Solo({ group }: { group: ControlGroup }) {
  const soloed = useStore(session, (state) => state.show.solo.includes(group.path));
  const toggle = (): void => {
    const { solo } = session.get().show;
    show({ solo: soloed ? solo.filter((path) => path !== group.path) : [...solo, group.path] });
  };
  return (
    <ActionIcon
      size="sm"
      variant={soloed ? "filled" : "subtle"}
      color={soloed ? "yellow.4" : "gray"}
      c={soloed ? "dark.9" : undefined}
      aria-label={`Solo ${group.label}`}
      aria-pressed={soloed}
      title="Show this light alone"
      onClick={toggle}
    >
      <SoloIcon />
    </ActionIcon>
  );
}

/** The looks of a light, and the way to a look of its own. */
function Uses({ group, paths }: { group: ControlGroup; paths: string[] }) {
  const groups = useStore(session, (state) => state.scene?.controls);
  return (
    <div className={styles.uses}>
      {paths.length > 0 ? "Looks:" : "No look"}
      {paths.map((path) => (
        <button key={path} type="button" className={styles.link} onClick={() => goToGroup(path)}>
          {groups?.find((each) => each.path === path)?.label ?? lastName(path)}
        </button>
      ))}
      <span className={styles.usesEnd}>
        <Presets factor="look" path={group.path} text="New look" whose={`of ${group.label}`} />
      </span>
    </div>
  );
}

/** The lights that use a look, each with the way back to it. */
function UsedBy({ path }: { path: string }) {
  const groups = useStore(session, (state) => state.scene?.controls);
  const lights = (groups ?? []).filter((each) => each.uses.includes(path));
  return (
    <>
      {lights.length > 0 ? "Used by:" : "Not used"}
      {lights.map((light) => (
        <button key={light.path} type="button" className={styles.link} onClick={() => goToGroup(light.path)}>
          {light.label}
        </button>
      ))}
    </>
  );
}

/** Keeps a look in the library, where other shots find it among their presets. */
function KeepLook({ group }: { group: ControlGroup }) {
  const kept = useStore(session, (state) => (state.kept?.path === group.path ? state.kept.label : null));
  return (
    <>
      <span role="status">{kept !== null && `kept as ${kept}`}</span>
      <Button
        size="compact-xs"
        variant="default"
        title="Keep this look in the library, for other shots"
        onClick={() => keepLook(group.path)}
      >
        Keep look
      </Button>
    </>
  );
}

function Section({ name, owner, controls, forced, look }: SectionProps) {
  const key = `${owner} ${name}`;
  const factor = name.toLowerCase();
  const open = useStore(panel, (state) => !state.closedSections.has(key)) || forced;
  return (
    <section className={styles.section}>
      <div className={styles.sectionHeader}>
        <h4 className={styles.heading}>
          <button
            type="button"
            className={styles.sectionButton}
            aria-expanded={open}
            disabled={forced}
            onClick={() => toggleSection(key)}
          >
            <ChevronIcon /> {name}
          </button>
        </h4>
        {look !== null && factor !== "look" && (
          <Presets factor={factor} path={owner} text="Presets" whose={`of ${look}, ${factor}`} stays />
        )}
      </div>
      {open && controls.map((control) => <ControlRow key={control.path} control={control} />)}
    </section>
  );
}

interface SectionProps {
  name: string;
  owner: string;
  controls: ControlItem[];
  /** Open because of a search. */
  forced: boolean;
  /** The name of the look that it is a part of, null where it is of something else. */
  look: string | null;
}

interface GroupProps {
  group: ControlGroup;
  controls: ControlItem[];
  searching: boolean;
}

export const Group = memo(function Group({ group, controls, searching }: GroupProps) {
  const open = useStore(panel, (state) => state.openGroups.has(group.path)) || searching;
  const wrong = useStore(session, (state) => state.state?.problem?.path?.startsWith(`${group.path}.`) ?? false);
  // Controls without an effect are only found by a search. A text, so that other values redraw nothing.
  const idle = useStore(session, ({ values }) =>
    searching ? "" : controls.flatMap((each) => (hasEffect(each, values) ? [] : [each.path])).join(" "),
  ).split(" ");
  const sections = Map.groupBy(
    controls.filter(({ path }) => !idle.includes(path)),
    (control) => control.section,
  );
  const onOff = group.kind === "light" ? onOffControl(group) : undefined;
  return (
    <div className={styles.group}>
      <div className={styles.groupHeader}>
        <h3 className={styles.heading}>
          <button
            id={groupId(group.path)}
            type="button"
            className={styles.groupButton}
            aria-expanded={open}
            disabled={searching}
            title={group.path}
            onClick={() => toggleGroup(group.path)}
          >
            <ChevronIcon />
            <span className={styles.groupLabel}>{group.label}</span>
            <span className={styles.groupType}>{group.type}</span>
            {wrong && (
              <span className={styles.wrong} role="img" aria-label="has a problem">
                <WarningIcon />
              </span>
            )}
          </button>
        </h3>
        {group.kind === "light" && <Solo group={group} />}
        {onOff && <OnOff group={group} control={onOff} />}
      </div>
      {open && (
        <div className={styles.groupBody}>
          {group.kind === "light" && <Uses group={group} paths={group.uses} />}
          {group.kind === "look" && !searching && (
            <div className={styles.uses}>
              <UsedBy path={group.path} />
              <span className={styles.usesEnd}>
                <KeepLook group={group} />
                <Presets factor="look" path={group.path} text="Presets" whose={`of ${group.label}`} stays />
              </span>
            </div>
          )}
          {[...sections].map(([name, members]) => (
            <Section
              key={name}
              name={name}
              owner={group.path}
              controls={members}
              forced={searching}
              look={group.kind === "look" ? group.label : null}
            />
          ))}
        </div>
      )}
    </div>
  );
});
