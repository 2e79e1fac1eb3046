import { PageHead } from '../ui';

export function Explore() {
  return <PageHead title="Explore" text="This page is being built." />;
}
