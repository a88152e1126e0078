import { describe, expect, it } from "vitest";
import { EventParser } from "./sse";

describe("EventParser", () => {
  it("gives events when they are complete, however they are cut", () => {
    const parser = new EventParser();
    expect(parser.take("id: 7\nevent: plan_ma")).toEqual([]);
    expect(parser.take('de\ndata: {"a":1}\n')).toEqual([]);
    expect(parser.take("\nid: 8\r\nevent: image_received\r\ndata: x\r\n\r\n")).toEqual([
      { id: "7", kind: "plan_made", data: '{"a":1}' },
      { id: "8", kind: "image_received", data: "x" },
    ]);
  });

  it("ignores comments that only keep the connection open", () => {
    expect(new EventParser().take(": ping\n\n")).toEqual([]);
  });
});
