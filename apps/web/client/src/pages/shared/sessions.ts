// The live session of a page: found again after a reload, started, ended.
import { useEffect, useState } from 'preact/hooks';
import { api, type Flags, type Session } from '../../api';
import { attempt } from '../../ui/toast';

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
      const session = await attempt(() =>
        api.startSession({ verb, inputs, flags, ...(name ? { name } : {}) }),
      );
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
