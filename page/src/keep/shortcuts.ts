/** Keys that work everywhere on the page. */

import { useEffect } from "react";
import { command, save } from "../session/session";

const OWN_UNDO = "data-own-undo";

/**
 * Marks a field whose text is not part of the scene, or not yet, such as a search field, or a field whose text is not
 * confirmed: in it, undo is the browser's own.
 */
export function ownUndo(own = true): Record<string, true | undefined> {
  return { [OWN_UNDO]: own || undefined };
}

function isTextField(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && target.matches("input:not([type=checkbox], [type=radio]), textarea, select");
}

export function useShortcuts(onHelp: () => void): void {
  useEffect(() => {
    const onKeyDown = (event: KeyboardEvent): void => {
      const target = event.target instanceof Element ? event.target : null;
      if (event.key === "?" && !isTextField(target)) {
        event.preventDefault();
        onHelp();
        return;
      }
      if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
      const key = event.key.toLowerCase();
      if (key === "s") {
        event.preventDefault();
        // A field that is being typed in confirms its value when it loses the focus.
        if (document.activeElement instanceof HTMLInputElement) {
          const field = document.activeElement;
          field.blur();
          field.focus();
        }
        save();
      } else if ((key === "z" || key === "y") && !target?.closest(`[${OWN_UNDO}], [role=dialog][aria-modal]`)) {
        event.preventDefault();
        command(key === "y" || event.shiftKey ? "redo" : "undo");
      }
    };
    window.addEventListener("keydown", onKeyDown);
    return () => window.removeEventListener("keydown", onKeyDown);
  }, [onHelp]);
}
