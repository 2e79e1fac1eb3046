// SPDX-License-Identifier: MIT
#include "origin_rules.h"

#include "tarsier/core/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tarsier::web {
namespace {

OriginRules loopback() {
  OriginRules rules;
  rules.port = 8765;
  rules.hosts = {"localhost", "127.0.0.1", "[::1]"};
  return rules;
}

OriginRules::Head request(std::string_view host) {
  OriginRules::Head head;
  head.method = "GET";
  head.path = "/api/info";
  head.host = host;
  return head;
}

int status(const OriginRules& rules, const OriginRules::Head& head) {
  const auto refusal = rules.refusal(head);
  return refusal ? refusal->status : 200;
}

TEST(OriginRules, AcceptsOnlyItsOwnHosts) {
  const OriginRules rules = loopback();
  for (const char* host : {"localhost:8765", "127.0.0.1:8765", "[::1]:8765", "LocalHost:8765"})
    EXPECT_EQ(status(rules, request(host)), 200) << host;
  for (const char* host :
       {"evil.example:8765", "localhost", "localhost:80", "localhost:08765x", "127.0.0.1.evil:8765",
        "[::1]", "[::1:8765", "localhost:", "a b:8765", "localhost:8765:8765", "127.0.0.2:8765"})
    EXPECT_EQ(status(rules, request(host)), 421) << host;
  EXPECT_EQ(status(rules, request("")), 400);
}

TEST(OriginRules, TheDefaultPortMayBeOmitted) {
  OriginRules rules = loopback();
  rules.port = 80;
  EXPECT_EQ(status(rules, request("localhost")), 200);
  EXPECT_EQ(status(rules, request("localhost:80")), 200);
  rules.tls = true;
  EXPECT_EQ(status(rules, request("localhost")), 421);
  rules.port = 443;
  EXPECT_EQ(status(rules, request("localhost")), 200);
}

TEST(OriginRules, AcceptsOnlyItsOwnOrigin) {
  const OriginRules rules = loopback();
  OriginRules::Head head = request("localhost:8765");
  head.origin = "http://localhost:8765";
  EXPECT_EQ(status(rules, head), 200);
  for (const char* origin :
       {"http://evil.example", "null", "https://localhost:8765", "http://localhost",
        "http://localhost:8765.evil.example", "localhost"}) {
    head.origin = origin;
    EXPECT_EQ(status(rules, head), 403) << origin;
  }
}

TEST(OriginRules, FetchSite) {
  const OriginRules rules = loopback();
  OriginRules::Head head = request("localhost:8765");
  for (const char* site : {"same-origin", "none"}) {
    head.fetch_site = site;
    EXPECT_EQ(status(rules, head), 200) << site;
  }
  // Another port of this machine is of the same site, and another program.
  for (const char* site : {"same-site", "cross-site"}) {
    head.fetch_site = site;
    head.fetch_mode = "navigate";
    head.fetch_dest = "document";
    head.path = "/api/info";
    EXPECT_EQ(status(rules, head), 403) << site;
    head.path = "/metrics";
    EXPECT_EQ(status(rules, head), 403) << site;
    head.path = "/live";
    EXPECT_EQ(status(rules, head), 200) << site;
    head.fetch_dest = "iframe";
    EXPECT_EQ(status(rules, head), 403) << site;
    head.fetch_dest = "document";
    head.method = "POST";
    EXPECT_EQ(status(rules, head), 403) << site;
    head.method = "GET";
  }
}

TEST(OriginRules, BehindAProxy) {
  OriginRules rules = loopback();
  rules.proxy_origin = normal_origin("https://Studio.Example:443/");
  EXPECT_EQ(rules.proxy_origin, "https://studio.example");
  OriginRules::Head head = request("studio.example");
  head.origin = "https://studio.example";
  EXPECT_EQ(status(rules, head), 200);
  head.host = "127.0.0.1:8765";  // a proxy that passes on our own name
  EXPECT_EQ(status(rules, head), 200);
  head.host = "studio.example:443";
  EXPECT_EQ(status(rules, head), 200);
  head.host = "studio.example:8765";
  EXPECT_EQ(status(rules, head), 421);
  head.host = "studio.example";
  for (const char* origin :
       {"http://studio.example", "https://studio.example:444", "https://evil.example"}) {
    head.origin = origin;
    EXPECT_EQ(status(rules, head), 403) << origin;
  }
}

TEST(NormalOrigin, RefusesInvalidOrigins) {
  EXPECT_EQ(normal_origin("http://a:80"), "http://a");
  EXPECT_EQ(normal_origin("https://a:80"), "https://a:80");
  EXPECT_EQ(normal_origin("https://[::1]:8765"), "https://[::1]:8765");
  for (const char* text : {"", "a", "ftp://a", "https://", "https://a/b", "https://a:0",
                           "https://a:70000", "https://u@a", "https://a?b", "https://[x]"})
    EXPECT_THROW((void)normal_origin(text), UsageError) << text;
}

}  // namespace
}  // namespace tarsier::web
