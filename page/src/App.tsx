/** The page: bars above and below, the viewport, and the side panel. */

import { Tabs } from "@mantine/core";
import { useCallback, useEffect, useState } from "react";
import styles from "./app.module.css";
import { ControlPanel } from "./controls/ControlPanel";
import { HelpDialog } from "./keep/HelpDialog";
import { KeepBar } from "./keep/KeepBar";
import { Notices } from "./keep/Notices";
import { useShortcuts } from "./keep/shortcuts";
import { PixelPanel } from "./quadrature/PixelPanel";
import { session } from "./session/session";
import { useStore } from "./session/store";
import { TimeBar } from "./time/TimeBar";
import { Toolbar } from "./toolbar/Toolbar";
import { Viewport } from "./viewport/Viewport";
import { view } from "./viewport/view";

export function App() {
  const [help, setHelp] = useState(false);
  const openHelp = useCallback(() => setHelp(true), []);
  useShortcuts(openHelp);
  const panel = useStore(view, (state) => state.panel);
  const name = useStore(session, (state) => state.scene?.name);
  const saved = useStore(session, (state) => state.saved);
  useEffect(() => {
    document.title = `${saved ? "" : "• "}${name ?? "photonbeams"} – photonbeams studio`;
  }, [name, saved]);
  return (
    <div className={styles.page}>
      <KeepBar onHelp={openHelp} />
      <Notices />
      <main className={styles.main}>
        <div className={styles.left}>
          <Toolbar />
          <Viewport />
          <TimeBar />
        </div>
        <aside className={styles.side} aria-label="Controls and pixel">
          <Tabs
            className={styles.tabs}
            classNames={{ panel: styles.tabPanel }}
            value={panel}
            onChange={(value) => view.set({ panel: value === "pixel" ? "pixel" : "controls" })}
          >
            <Tabs.List>
              <Tabs.Tab value="controls">Controls</Tabs.Tab>
              <Tabs.Tab value="pixel">Pixel</Tabs.Tab>
            </Tabs.List>
            <Tabs.Panel value="controls">{panel === "controls" && <ControlPanel />}</Tabs.Panel>
            <Tabs.Panel value="pixel">{panel === "pixel" && <PixelPanel />}</Tabs.Panel>
          </Tabs>
        </aside>
      </main>
      <HelpDialog opened={help} onClose={() => setHelp(false)} />
    </div>
  );
}
