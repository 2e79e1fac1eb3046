// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace tarsier::web {

class AuditLog;
class Router;
class Workspace;
struct Response;

// A response with a file of the workspace. A browser may show images and videos; every other file
// is a download, whatever its name.
[[nodiscard]] Response file_response(const std::string& path, const std::string& name);

// The same; with ?width=N (16..2048) a thumbnail of an image.
[[nodiscard]] Response image_response(Workspace& workspace, const std::string& path,
                                      const std::string& name, const std::string& width,
                                      const std::string& own_program);

// Adds /api/sets .. and /api/state ..; `own_program` makes thumbnails (Workspace::thumbnail).
void bind_files(Router& router, Workspace& workspace, AuditLog& audit,
                const std::string& own_program);

}  // namespace tarsier::web
