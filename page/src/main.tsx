// Before the components, whose own styles come after these and win.
import "./mantine.css";
import "./page.css";
import { createTheme, MantineProvider, Modal } from "@mantine/core";
import { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import { App } from "./App";
import { connect } from "./session/session";

const theme = createTheme({
  fontFamily: "system-ui, sans-serif",
  fontFamilyMonospace: "ui-monospace, Menlo, Consolas, monospace",
  primaryColor: "blue",
  // Dark enough for white text on it to be readable (WCAG AA).
  primaryShade: 8,
  defaultRadius: "sm",
  focusRing: "auto",
  components: { Modal: Modal.extend({ defaultProps: { closeButtonProps: { "aria-label": "Close" } } }) },
});

const root = document.getElementById("root");
if (!root) throw new Error("index.html has no #root");
createRoot(root).render(
  <StrictMode>
    <MantineProvider theme={theme} forceColorScheme="dark">
      <App />
    </MantineProvider>
  </StrictMode>,
);
connect();
