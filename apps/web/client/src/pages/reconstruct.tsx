import { PageHead } from '../ui';

export function Reconstruct() {
  return <PageHead title="Reconstruct" text="This page is being built." />;
}
