// @vitest-environment jsdom
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, render, screen } from "@testing-library/react";
import { afterEach, beforeAll, describe, expect, it } from "vitest";
import type { ReadCase } from "../api/types";
import { startLanguages } from "../languages";
import VerifyForm from "./VerifyForm";

const READ = {
  view: { id: "case-1", procedure: { wired_hole_ids: [] } },
  etag: '"1-a"',
} as unknown as ReadCase;

function shownWith(localisation: number | null) {
  const client = new QueryClient({ defaultOptions: { queries: { staleTime: Number.POSITIVE_INFINITY } } });
  client.setQueryData(
    ["case", "case-1", "images", 4],
    [{ id: "a", header: null, localisation, skipped: null }],
  );
  render(
    <QueryClientProvider client={client}>
      <VerifyForm read={READ} />
    </QueryClientProvider>,
  );
  return screen.getByRole("button", { name: "Verify the guide" }) as HTMLButtonElement;
}

describe("VerifyForm", () => {
  beforeAll(startLanguages);
  afterEach(cleanup);

  it("waits until the image is localised, and says so", () => {
    expect(shownWith(null).disabled).toBe(true);
    expect(screen.getByText("The image is being localised …")).toBeTruthy();
  });

  it("verifies an image that is localised", () => {
    expect(shownWith(3).disabled).toBe(false);
    expect(screen.queryByText("The image is being localised …")).toBeNull();
  });
});
