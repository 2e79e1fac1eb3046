// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::web {

class Router;
class VerbTable;

// The description of the studio's interface (OpenAPI 3.1): each route of the router, each verb for
// images with its flags by type, range and choices, and the schemas of the JSON lines. Each has a
// curl command that works unchanged if TARSIER_URL and TARSIER_TOKEN are set.
[[nodiscard]] nlohmann::json openapi_json(const VerbTable& verbs, const Router& router,
                                          std::string_view version);

// Routes without a description ("GET /api/x"); a test requires that there are none. Pages and
// assets are not part of the interface.
[[nodiscard]] std::vector<std::string> undescribed_routes(const Router& router);

}  // namespace tarsier::web
