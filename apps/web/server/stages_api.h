// SPDX-License-Identifier: MIT
#pragma once

namespace tarsier::web {

class Live;
class Router;

// GET /api/sessions/{id}/stages?after=N: the images of the stages of a frame, for sessions whose
// verb has --debug-dir ("stages": true in the Session). The body is record D of pipe_window.h,
// without length and kind; the header X-Tarsier-Stages is its number. Waits up to 2 s for one that
// is newer than N; 204 where none came, 409 where the session gives none.
void bind_stages(Router& router, const Live& live);

}  // namespace tarsier::web
