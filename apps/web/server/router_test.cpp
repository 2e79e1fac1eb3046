// SPDX-License-Identifier: MIT
#include "router.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace tarsier::web {
namespace {

using testing::ElementsAre;
using testing::Pair;

Response answer(const Request&) { return {}; }

TEST(Router, FindsTheMostLiteralPattern) {
  Router router;
  router.add("GET", "/{page...}", answer, Access::kPublic);
  router.add("GET", "/", answer, Access::kPublic);
  router.add("GET", "/api/jobs/{id}", answer);
  router.add("GET", "/api/jobs/new", answer);
  router.add("GET", "/api/jobs/{id}/files/{path...}", answer);
  const auto pattern = [&](std::string_view path) {
    const auto match = router.find("GET", path);
    return match.route == nullptr ? std::string("none") : match.route->pattern;
  };
  EXPECT_EQ(pattern("/"), "/");
  EXPECT_EQ(pattern("/live"), "/{page...}");
  EXPECT_EQ(pattern("/api/jobs/7"), "/api/jobs/{id}");
  EXPECT_EQ(pattern("/api/jobs/new"), "/api/jobs/new");
  EXPECT_EQ(pattern("/api/jobs/7/files/a/b.png"), "/api/jobs/{id}/files/{path...}");
  EXPECT_EQ(pattern("/api/jobs/7/files"), "/{page...}");
  EXPECT_EQ(router.find("HEAD", "/api/jobs/7").params.at("id"), "7");
  EXPECT_EQ(router.find("GET", "/api/jobs/7/files/a/b.png").params.at("path"), "a/b.png");
}

TEST(Router, ReportsAllowedMethods) {
  Router router;
  router.add("POST", "/api/sets", answer);
  router.add("GET", "/api/sets", answer);
  router.add("DELETE", "/api/sets/{name}", answer);
  EXPECT_EQ(router.find("PUT", "/api/sets").allowed, "GET, POST");
  EXPECT_EQ(router.find("GET", "/api/sets/a").allowed, "DELETE");
  const auto nothing = router.find("GET", "/api/other");
  EXPECT_EQ(nothing.route, nullptr);
  EXPECT_EQ(nothing.allowed, "");
}

TEST(Router, RefusesBrokenPatterns) {
  Router router;
  router.add("GET", "/a", answer);
  EXPECT_THROW(router.add("GET", "/a", answer), std::invalid_argument);
  EXPECT_THROW(router.add("GET", "a", answer), std::invalid_argument);
  EXPECT_THROW(router.add("PATCH", "/b", answer), std::invalid_argument);
  EXPECT_THROW(router.add("GET", "/{rest...}/b", answer), std::invalid_argument);
  EXPECT_THROW(router.add("GET", "/{open", answer), std::invalid_argument);
}

TEST(Router, SignedInIsTheDefault) {
  Router router;
  router.add("GET", "/a", answer);
  EXPECT_EQ(router.routes().front()->access, Access::kSignedIn);
}

TEST(Request, ReadsJson) {
  Request request;
  request.content_type = "application/json";
  request.body = R"({"a":"b","list":["x","y"],"n":null})";
  const auto value = request.json();
  EXPECT_EQ(text_member(value, "a"), "b");
  EXPECT_EQ(optional_text(value, "n"), std::nullopt);
  EXPECT_THROW((void)text_member(value, "list"), HttpError);
  EXPECT_THROW((void)text_member(value, "absent"), HttpError);
  request.body = "{";
  EXPECT_THROW((void)request.json(), HttpError);
  request.body = std::string(40, '[') + std::string(40, ']');
  EXPECT_THROW((void)request.json(), HttpError);
  request.body = "{}";
  request.content_type = "text/plain";
  try {
    (void)request.json();
    ADD_FAILURE();
  } catch (const HttpError& error) {
    EXPECT_EQ(error.status(), 415);
  }
}

TEST(Response, JsonOfBrokenUtf8) {
  EXPECT_EQ(json_response({{"name", "\xff"}}).body, "{\"name\":\"\xef\xbf\xbd\"}\n");
  EXPECT_EQ(error_response(404, "gone").status, 404);
  EXPECT_EQ(error_response(404, "gone").body, "{\"error\":\"gone\"}\n");
}

TEST(Query, IsDecoded) {
  const auto query = parse_query("a=1&b=x+y%26z&&c&a=2");
  ASSERT_TRUE(query);
  EXPECT_THAT(*query,
              ElementsAre(Pair("a", "1"), Pair("b", "x y&z"), Pair("c", ""), Pair("a", "2")));
  EXPECT_EQ(parse_query("a=%"), std::nullopt);
  EXPECT_EQ(parse_query("a=%0"), std::nullopt);
  EXPECT_EQ(parse_query("a=%00"), std::nullopt);
  EXPECT_EQ(percent_decoded("a+b%2Fc", false), "a+b/c");
}

}  // namespace
}  // namespace tarsier::web
