import { PageHead } from '../ui';

export function Train() {
  return <PageHead title="Train" text="This page is being built." />;
}
