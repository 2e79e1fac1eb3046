// The live session of a page: found again after a reload, started, ended.
import { useEffect, useState } from 'preact/hooks';
import { api, ApiError, type Flags, type Session } from '../../api';
import { attempt } from '../../ui/toast';
import { startViewerCamera } from '../../viewer_camera';

// Sources that stand for the viewer's own camera until the session begins.
export const ownCamera = 'own-camera';
export const ownCameraBack = 'own-camera-back';

export interface AreaSession {
  id: string | undefined;
  start: (inputs: string[], flags: Flags, name?: string) => Promise<Session | undefined>;
  // Lets the session save its result, and removes it. Undefined: it failed; it stays until it is finished again.
  finish: () => Promise<Session | undefined>;
  end: () => Promise<void>;
  forget: () => void;
}

// Asks a session to save its result and to end, and waits for its end.
export async function quitSession(id: string, pauseMs = 200): Promise<Session> {
  // A session that fails while it ends has not handled the event.
  const problem = await api.sendEvents(id, [{ action: 'quit' }]).catch((error: unknown) => error);
  let session = await api.sessionOf(id);
  if (session.running && problem) throw problem;
  for (let tries = 0; session.running; tries++) {
    if (tries === 300) throw new Error('The session has not ended yet. Try again in a moment.');
    await new Promise((done) => setTimeout(done, pauseMs));
    session = await api.sessionOf(id);
  }
  return session;
}

// Why a session that ended has saved nothing; '' if it ended well.
export function problemOfSession(session: Session): string {
  if (session.exit === 0) return '';
  const last = session.log[session.log.length - 1];
  // Status 1: it found nothing, and a warning says what.
  return (session.exit === 1 ? last?.replace(/^tarsier: \w+: /, '') : session.error) || 'The session failed.';
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
    finish: async () => {
      if (id === undefined) return undefined;
      return attempt(async () => {
        try {
          const now = await api.sessionOf(id);
          const last = now.running ? await quitSession(id) : now;
          const problem = problemOfSession(last);
          if (now.running && problem !== '') throw new Error(`Not saved: ${problem}`);
          await api.endSession(id);
          setId(undefined);
          return problem === '' ? last : undefined;
        } catch (error) {
          if (error instanceof ApiError && error.status === 404) setId(undefined);
          throw error;
        }
      });
    },
    end: async () => {
      if (id === undefined) return;
      await attempt(() => api.endSession(id));
      setId(undefined);
    },
  };
}
