/** Whether this browser can draw in three dimensions (WebGL 2). */
export function hasGraphics(): boolean {
  try {
    const context = document.createElement("canvas").getContext("webgl2");
    // Contexts are few: give this one back at once.
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return context !== null;
  } catch {
    return false;
  }
}
