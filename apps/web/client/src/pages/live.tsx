import { PageHead } from '../ui';

export function Live() {
  return <PageHead title="Live" text="This page is being built." />;
}
