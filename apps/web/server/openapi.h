// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::web {

class Router;
class VerbTable;

// The description of the studio's interface (OpenAPI 3.1): each route of the table, each verb that
// takes images with its flags by type, range and choices, the schemas of the JSON lines, and for
// each a curl command that works as it stands once TARSIER_URL and TARSIER_TOKEN are set.
[[nodiscard]] nlohmann::json openapi_json(const VerbTable& verbs, const Router& router,
                                          std::string_view version);

// Routes that the description has no text for ("GET /api/x"): a test wants none. Pages and assets
// are no part of the interface.
[[nodiscard]] std::vector<std::string> undescribed_routes(const Router& router);

}  // namespace tarsier::web
