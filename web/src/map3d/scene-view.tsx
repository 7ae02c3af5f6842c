import type { ComponentChildren } from 'preact';
import { useEffect, useRef, useState } from 'preact/hooks';
import { Empty } from '../ui/empty';
import { MapScene } from './scene';

/**
 * A scene in the page. `onReady` gets it once and may answer what to do before it goes; `children`
 * lie over it. Views load this lazily, so that three.js comes with the first scene only.
 */
export function SceneView(props: {
  onReady: (scene: MapScene) => void | (() => void);
  children?: ComponentChildren;
}) {
  const host = useRef<HTMLDivElement>(null);
  const [failed, setFailed] = useState<string | null>(null);
  useEffect(() => {
    let scene: MapScene;
    try {
      scene = new MapScene(host.current!);
    } catch (error) {
      setFailed(error instanceof Error ? error.message : String(error));
      return undefined;
    }
    const end = props.onReady(scene);
    return () => {
      end?.();
      scene.dispose();
    };
  }, []);
  return (
    <div class="scene" ref={host}>
      {failed === null ? (
        props.children
      ) : (
        <Empty title="This browser cannot draw in 3-D" icon="warn">
          <p>{failed}</p>
        </Empty>
      )}
    </div>
  );
}
