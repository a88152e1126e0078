/** What draws the scene: nothing, the processor (then a finer picture costs frames), or a graphics card. */
export type Graphics = "none" | "processor" | "card";

const PROCESSOR = /swiftshader|llvmpipe|softpipe|software|basic render/i;

/** Asks this browser (WebGL 2). */
export function findGraphics(): Graphics {
  try {
    const context = new OffscreenCanvas(1, 1).getContext("webgl2");
    if (context === null) return "none";
    const told = context.getExtension("WEBGL_debug_renderer_info");
    const name = context.getParameter(told?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER);
    // Contexts are few: give this one back at once.
    context.getExtension("WEBGL_lose_context")?.loseContext();
    return graphicsNamed(String(name));
  } catch {
    return "none";
  }
}

/** By the name that its driver gives. */
export function graphicsNamed(renderer: string): Graphics {
  return PROCESSOR.test(renderer) ? "processor" : "card";
}
