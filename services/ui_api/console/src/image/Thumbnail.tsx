import { useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { onConnection } from "../api/connections";

interface Props {
  /** Of the picture at the gateway. */
  readonly address: string;
  readonly width_px: number;
  readonly alt: string;
}

/** A small picture. Many come at once: by themselves they would take all connections of the browser, the stop's too. */
export default function Thumbnail({ address, width_px, alt }: Props) {
  const small = `${address}${address.includes("?") ? "&" : "?"}width=${width_px}`;
  const blob = useQuery({
    queryKey: ["thumbnail", small],
    queryFn: ({ signal }) => fetched(small, signal),
    staleTime: Number.POSITIVE_INFINITY,
  }).data;
  const [shown, setShown] = useState<string | undefined>(undefined);
  useEffect(() => {
    if (blob === undefined) return;
    const made = URL.createObjectURL(blob);
    setShown(made);
    return () => URL.revokeObjectURL(made);
  }, [blob]);
  return <img src={shown} alt={alt} />;
}

async function fetched(address: string, signal: AbortSignal): Promise<Blob> {
  const answer = await onConnection("long", (within) => fetch(address, { signal: within }), signal);
  if (!answer.ok) throw new Error(`status ${answer.status}`);
  return await answer.blob();
}

/** Where the gateway has an image's picture. */
export function pictureAddress(image: string): string {
  return `/api/v1/images/${image}.png?view=raw`;
}
