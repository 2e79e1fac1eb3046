# SPDX-License-Identifier: MIT
"""Common parts of the tests of the areas' pages."""

import os
import unittest

import pages

LONG = pages.LONG
# TARSIER_WEB_LOOK=1 saves every screen of every path at every width, for people to look at.
WIDTHS = (360, 800, 1440) if os.environ.get("TARSIER_WEB_LOOK") else (360,)


long = unittest.skipUnless(os.environ.get("TARSIER_TEST_ALL"), "long: ./test --all runs it")


class AreaPageTest(pages.PageTest):
    """One server and one browser for all. Tests run in the order of their names."""

    def path(self, name):
        """Checks a page of a path in the same way as all others."""
        self.check_page(f"path-{name}", widths=WIDTHS)

    def started(self, verb):
        """The number of jobs of a verb after the next one is started."""
        return 1 + len(self.jobs_of(verb))

    def job_of(self, verb, at_least=1):
        """The newest job of a verb, once it has ended and the verb has `count` jobs."""

        def over():
            jobs = self.jobs_of(verb)
            job = max(jobs, key=lambda one: str(one["created"]), default=None)
            return len(jobs) >= at_least and job["state"] not in ("queued", "running") and job

        return self.server.call(f"/api/jobs/{self.until(f'a job of {verb} ended', over)['id']}")[1]

    def state(self, verb):
        """The state of the running session of a verb."""
        for one in self.server.call("/api/sessions")[1]["sessions"]:
            if one["verb"] == verb and one["running"]:
                return self.server.call(f"/api/sessions/{one['id']}")[1]
        return None

    def values(self, verb):
        """The state values that this session reports; empty before its first image."""
        return (self.state(verb) or {}).get("state") or {}

    def named(self, role, part):
        return next(name for _, name, _ in self.page.find_all(role) if part in name)
