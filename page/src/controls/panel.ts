/** What is open in the list of controls, what is searched for, and which control is explained. */

import type { ControlItem, ControlGroup } from "../protocol";
import { Store } from "../session/store";

interface Panel {
  search: string;
  openGroups: ReadonlySet<string>;
  /** Sections by group path and name. They are open unless they are named here. */
  closedSections: ReadonlySet<string>;
  explained: ControlItem | null;
}

export const panel = new Store<Panel>({
  search: "",
  openGroups: new Set(),
  closedSections: new Set(),
  explained: null,
});

function toggled(set: ReadonlySet<string>, item: string): Set<string> {
  const next = new Set(set);
  if (!next.delete(item)) next.add(item);
  return next;
}

export function toggleGroup(path: string): void {
  panel.set({ openGroups: toggled(panel.get().openGroups, path) });
}

export function toggleSection(key: string): void {
  panel.set({ closedSections: toggled(panel.get().closedSections, key) });
}

/** Open a group and put the focus on it: from a light to its look, for instance. */
export function goToGroup(path: string): void {
  panel.set({ search: "", openGroups: new Set(panel.get().openGroups).add(path) });
  window.setTimeout(() => {
    const header = document.getElementById(groupId(path));
    header?.scrollIntoView({ block: "start" });
    header?.focus();
  });
}

export function groupId(path: string): string {
  return `group${path.replaceAll("/", "-")}`;
}

/** The group's controls in which every searched word occurs, in their own names or the group's. */
export function matching(group: ControlGroup, search: string): ControlItem[] {
  const words = search.toLowerCase().split(/\s+/).filter(Boolean);
  if (words.length === 0) return group.controls;
  const context = `${group.label} ${group.type} ${group.path}`.toLowerCase();
  return group.controls.filter((control) => {
    const text = `${context} ${control.label} ${control.section} ${control.path}`.toLowerCase();
    return words.every((word) => text.includes(word));
  });
}
