import { useEffect, useRef, useState } from 'preact/hooks';

/** A picture that only the API has: fetched with the token when it comes into sight. */
export function Picture(props: {
  load: () => Promise<Blob>;
  /** Another picture when it changes. */
  name: string;
  alt: string;
  lazy?: boolean;
}) {
  const host = useRef<HTMLDivElement>(null);
  const [source, setSource] = useState<string | null>(null);
  const [failed, setFailed] = useState<string | null>(null);
  useEffect(() => {
    let url: string | null = null;
    let over = false;
    const start = () => {
      props.load().then(
        (bytes) => {
          if (over) return;
          url = URL.createObjectURL(bytes);
          setFailed(null);
          setSource(url);
        },
        (error: unknown) => over || setFailed(error instanceof Error ? error.message : String(error)),
      );
    };
    const observer = new IntersectionObserver(([entry]) => {
      if (!entry?.isIntersecting) return;
      observer.disconnect();
      start();
    }, { rootMargin: '200px' });
    if (props.lazy) observer.observe(host.current!);
    else start();
    return () => {
      over = true;
      observer.disconnect();
      if (url) URL.revokeObjectURL(url);
      setSource(null);
    };
  }, [props.name]);
  return (
    <div class="picture" ref={host}>
      {source && <img src={source} alt={props.alt} decoding="async" />}
      {failed && <span class="muted">{failed}</span>}
    </div>
  );
}
