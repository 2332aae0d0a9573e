/** What can be done with the edits: undo, redo, save, revert, and render the final picture. */

import { ActionIcon, Anchor, Button, Modal, Progress } from "@mantine/core";
import { useState } from "react";
import { CloseIcon, RedoIcon, UndoIcon } from "../common/icons";
import { cancelRender, command, forgetRender, save, session } from "../session/session";
import { useStore } from "../session/store";
import styles from "./keep.module.css";
import { RenderDialog } from "./RenderDialog";

function Revert() {
  const [asking, setAsking] = useState(false);
  const open = useStore(session, (state) => state.open);
  return (
    <>
      <Button size="compact-xs" variant="default" disabled={!open} onClick={() => setAsking(true)}>
        Revert
      </Button>
      <Modal opened={asking} onClose={() => setAsking(false)} title="Revert all edits?" size="sm" centered>
        <p className={styles.sentence}>Everything goes back to the scene's own values. You can undo this.</p>
        <div className={styles.buttons}>
          <Button size="xs" variant="default" data-autofocus onClick={() => setAsking(false)}>
            Keep the edits
          </Button>
          <Button
            size="xs"
            color="red"
            onClick={() => {
              command("revert");
              setAsking(false);
            }}
          >
            Revert
          </Button>
        </div>
      </Modal>
    </>
  );
}

function FinalPicture() {
  const render = useStore(session, (state) => state.render);
  const open = useStore(session, (state) => state.open);
  const [dialog, setDialog] = useState(false);
  const problem = render?.problem ?? null;
  const running = render !== null && !render.file && !render.written && problem === null;
  return (
    <div className={styles.group}>
      {running && (
        <>
          <Progress.Root size="sm" className={styles.progress}>
            <Progress.Section
              value={render.of > 0 ? (100 * render.done) / render.of : 0}
              aria-label="Progress of the final picture"
            />
          </Progress.Root>
          <span className={styles.note}>
            {render.done} of {render.of}
          </span>
          <Button size="compact-xs" variant="default" disabled={!open} onClick={cancelRender}>
            Cancel
          </Button>
        </>
      )}
      <span role="status" className={styles.group}>
        {render?.file && (
          <Anchor href={render.file} download size="xs">
            Download the picture
          </Anchor>
        )}
        {render?.written && (
          <span className={styles.name} title={render.written}>
            Written: {render.written.slice(render.written.lastIndexOf("/") + 1)}
          </span>
        )}
        {problem !== null && <span className={styles.problem}>{problem}</span>}
      </span>
      {render !== null && !running && (
        <ActionIcon size="xs" variant="subtle" color="gray" aria-label="Dismiss the result" onClick={forgetRender}>
          <CloseIcon />
        </ActionIcon>
      )}
      {!running && (
        <Button size="compact-xs" disabled={!open} onClick={() => setDialog(true)}>
          Render this…
        </Button>
      )}
      <RenderDialog opened={dialog} onClose={() => setDialog(false)} />
    </div>
  );
}

export function KeepBar({ onHelp }: { onHelp: () => void }) {
  const name = useStore(session, (state) => state.scene?.name ?? "");
  const open = useStore(session, (state) => state.open);
  const canUndo = useStore(session, (state) => state.canUndo);
  const canRedo = useStore(session, (state) => state.canRedo);
  const saved = useStore(session, (state) => state.saved);
  return (
    <section className={styles.bar} aria-label="Scene">
      <h1 className={styles.title}>photonbeams studio</h1>
      <span className={styles.name}>{name}</span>
      <span className={styles.note} role="status">
        {saved ? "" : "not saved"}
      </span>
      <span className={styles.filler} />
      <FinalPicture />
      <div className={styles.group}>
        <ActionIcon
          size="sm"
          variant="default"
          aria-label="Undo"
          title="Undo (Ctrl+Z)"
          disabled={!open || !canUndo}
          onClick={() => command("undo")}
        >
          <UndoIcon />
        </ActionIcon>
        <ActionIcon
          size="sm"
          variant="default"
          aria-label="Redo"
          title="Redo (Ctrl+Shift+Z)"
          disabled={!open || !canRedo}
          onClick={() => command("redo")}
        >
          <RedoIcon />
        </ActionIcon>
        <Button
          size="compact-xs"
          variant="default"
          title="Save (Ctrl+S)"
          disabled={!open}
          onClick={() => save()}
        >
          Save
        </Button>
        <Revert />
      </div>
      <ActionIcon size="sm" variant="default" aria-label="Keys" title="Keys (?)" onClick={onHelp}>
        ?
      </ActionIcon>
    </section>
  );
}
