import { PageHead } from '../ui/controls';

export function Home() {
  return <PageHead title="Tarsier studio" text="This page is being built." />;
}
