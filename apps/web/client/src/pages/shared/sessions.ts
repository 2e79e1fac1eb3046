// The live session of a page: found again after a reload, started, ended.
import { useEffect, useState } from 'preact/hooks';
import { api, type Flags, type Session } from '../../api';
import { attempt } from '../../ui/toast';
import { startViewerCamera } from '../../viewer_camera';

// Sources that stand for the viewer's own camera until the session begins.
export const ownCamera = 'own-camera';
export const ownCameraBack = 'own-camera-back';

export interface AreaSession {
  id: string | undefined;
  start: (inputs: string[], flags: Flags, name?: string) => Promise<Session | undefined>;
  end: () => Promise<void>;
  forget: () => void;
}

// `verb`: the running session of this verb, if there is one, is taken up again.
export function useAreaSession(verb: string): AreaSession {
  const [id, setId] = useState<string | undefined>(undefined);
  useEffect(() => {
    let alive = true;
    api.sessions().then(
      (all) => {
        const mine = all.filter((one) => one.running && one.verb === verb);
        const last = mine[mine.length - 1];
        if (alive && last) setId((now) => now ?? last.id);
      },
      () => undefined,
    );
    return () => {
      alive = false;
    };
  }, [verb]);
  return {
    id,
    forget: () => setId(undefined),
    start: async (inputs, flags, name) => {
      const session = await attempt(async () => {
        const sources: string[] = [];
        for (const input of inputs) {
          if (input === ownCamera) sources.push(await startViewerCamera('user'));
          else if (input === ownCameraBack) sources.push(await startViewerCamera('environment'));
          else sources.push(input);
        }
        return api.startSession({ verb, inputs: sources, flags, ...(name ? { name } : {}) });
      });
      if (session) setId(session.id);
      return session;
    },
    end: async () => {
      if (id === undefined) return;
      await attempt(() => api.endSession(id));
      setId(undefined);
    },
  };
}
