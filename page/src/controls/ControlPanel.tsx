/** All lights, media and looks with their controls. */

import { CloseButton, Input } from "@mantine/core";
import { useDeferredValue, useEffect } from "react";
import { SearchIcon } from "../common/icons";
import { format } from "../common/numbers";
import { ownUndo } from "../keep/shortcuts";
import type { ControlItem, ControlGroup, Value } from "../protocol";
import { session } from "../session/session";
import { useStore } from "../session/store";
import styles from "./controls.module.css";
import { Group } from "./Group";
import { goToGroup, matching, panel, toggleGroup } from "./panel";

const KINDS: { kind: ControlGroup["kind"]; title: string }[] = [
  { kind: "light", title: "Lights" },
  { kind: "medium", title: "Media" },
  { kind: "look", title: "Looks" },
];

/** A value in a few characters. */
function short(value: Value): string {
  if (value === null || value === "") return "none";
  if (typeof value === "number") return format(value, 4);
  if (typeof value === "boolean") return value ? "on" : "off";
  if (typeof value === "string") return value;
  if (!Array.isArray(value)) return value.knots.length > 0 ? `${value.knots.length} keys` : "no ramp";
  return value.length > 0 ? value.map((each) => short(each as Value)).join(", ") : "none";
}

/** Says what the control under the pointer, or with the focus, is for. */
function Explanation({ control }: { control: ControlItem | null }) {
  return (
    <div className={styles.explanation} role="region" aria-label="Explanation of the control" tabIndex={0}>
      {control ? (
        <>
          <p className={styles.explanationText}>{control.doc || control.label}</p>
          <p className={styles.explanationPath}>
            {control.path.slice(control.path.lastIndexOf(".") + 1)} · default {short(control.default)}
          </p>
        </>
      ) : (
        <p className={styles.explanationText}>Point at a control to read what it is for.</p>
      )}
    </div>
  );
}

export function ControlPanel() {
  const groups = useStore(session, (state) => state.scene?.controls);
  const typed = useStore(panel, (state) => state.search);
  // A search opens every group that matches: typing must not wait for all of them to be drawn.
  const search = useDeferredValue(typed);
  const explained = useStore(panel, (state) => state.explained);
  const first = groups?.[0]?.path;

  // With everything closed a new page would look empty.
  useEffect(() => {
    if (first !== undefined && panel.get().openGroups.size === 0) toggleGroup(first);
  }, [first]);

  // A light's new look is opened, since it is edited next.
  const applied = useStore(session, (state) => state.applied);
  useEffect(() => {
    if (!applied) return;
    session.set({ applied: null });
    if (applied.look !== applied.path) goToGroup(applied.look);
  }, [applied]);

  const found = (groups ?? []).map((group) => ({ group, controls: matching(group, search) }));
  const shown = found.filter(({ controls }) => search === "" || controls.length > 0);
  return (
    <div className={styles.panel}>
      <Input
        className={styles.search}
        size="xs"
        type="search"
        placeholder="Search the controls"
        aria-label="Search the controls"
        leftSection={<SearchIcon />}
        rightSectionPointerEvents="all"
        rightSection={
          typed && (
            <CloseButton size="xs" aria-label="Clear the search" onClick={() => panel.set({ search: "" })} />
          )
        }
        value={typed}
        onChange={(event) => panel.set({ search: event.currentTarget.value })}
        {...ownUndo()}
      />
      <div className={styles.list}>
        {KINDS.map(({ kind, title }) => {
          const ofKind = shown.filter(({ group }) => group.kind === kind);
          if (ofKind.length === 0) return null;
          return (
            <section key={kind} aria-label={title}>
              <h2 className={styles.kind}>{title}</h2>
              {ofKind.map(({ group, controls }) => (
                <Group key={group.path} group={group} controls={controls} searching={search !== ""} />
              ))}
            </section>
          );
        })}
        {search !== "" && shown.length === 0 && <p className={styles.nothing}>No control matches.</p>}
      </div>
      <Explanation control={explained} />
    </div>
  );
}
