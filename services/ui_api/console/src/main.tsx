import { QueryClientProvider } from "@tanstack/react-query";
import { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import App from "./App";
import { newQueryClient } from "./api/queries";
import { startLanguages } from "./languages";
import "./styles/page.css";

const root = document.getElementById("root");
if (root === null) throw new Error("index.html has no element 'root'");
await startLanguages();
createRoot(root).render(
  <StrictMode>
    <QueryClientProvider client={newQueryClient()}>
      <App />
    </QueryClientProvider>
  </StrictMode>,
);
