#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Removes the studio's security rules, one by one, and checks that a test fails each time.

tests/web/rules_removed.py [--build build/release] [--table FILE] [NAME ..]
tests/web/rules_removed.py --check      only checks that each patch still finds its place

Works on a copy of apps/web/server and of the comparison of secrets. Each patch puts a rule under a condition, so that the
environment (TARSIER_RULE_OUT=NAME) disables it at run time. So the files with rules are compiled once, and server and unit
tests are linked once. With all rules, every test must pass; with a rule disabled, the test named with it must fail.
"""

import argparse
import glob
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SERVER = os.path.join(ROOT, "apps", "web", "server")
# The comparison of secrets contains a rule too.
SERVICE = os.path.join(ROOT, "src", "tarsier", "media", "http_service.cpp")
HERE = os.path.join(ROOT, "tests", "web")

# The condition of a patch: rule_is_out("name").
SWITCH = """#ifndef TARSIER_RULE_IS_OUT  // files are compiled together
#define TARSIER_RULE_IS_OUT
#include <cstdlib>
#include <string_view>
namespace {
[[maybe_unused]] bool rule_is_out(std::string_view name) {
  const char* out = std::getenv("TARSIER_RULE_OUT");
  return out != nullptr && name == out;
}
}  // namespace
#endif
"""

SECURITY, FILES, JOBS, LIVE, UNIT = "test_security.py", "test_files.py", "test_jobs.py", "test_live.py", "web_test"


def header(name, rule, what):
    """A header field of every answer."""
    return (rule, what, [(f'  header("{name}",', f'  if (!rule_is_out("{rule}")) header("{name}",')], SECURITY,
            "test_responses_carry_the_policy")


# (rule, its description, [(text, text with the rule under a condition)], file of the test, test)
RULES = [
    # Listening addresses.
    ("loopback", "listens on 127.0.0.1 and ::1 alone",
     [('    ListenAddress four = parse_listen_address(text("127.0.0.1", options.port));\n'
       '    http.sockets.push_back(listen_on(text("127.0.0.1", options.port), four));',
       '    const char* where = rule_is_out("loopback") ? "0.0.0.0" : "127.0.0.1";\n'
       "    ListenAddress four = parse_listen_address(text(where, options.port));\n"
       "    http.sockets.push_back(listen_on(text(where, options.port), four));")],
     SECURITY, "test_listens_on_loopback_only_by_default"),
    ("listen-all", "--listen-all needs TLS or a proxy",
     [("if (options.listen_all && !tls && !proxy)", 'if (options.listen_all && !tls && !proxy && !rule_is_out("listen-all"))')],
     SECURITY, "test_refuses_to_listen_openly_without_tls"),
    ("tls-key", "the key of the own certificate is the owner's (0600)",
     [("::open(key_path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);",
       '::open(key_path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, rule_is_out("tls-key") ? 0644 : 0600);')],
     SECURITY, "test_tls_with_a_certificate_of_its_own"),
    # Access.
    ("token-file", "the API token lies in a file of mode 0600",
     [("O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);\n  if (fd < 0) throw OutputError(temporary",
       'O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, rule_is_out("token-file") ? 0644 : 0600);\n'
       "  if (fd < 0) throw OutputError(temporary")],
     SECURITY, "test_secrets_are_in_private_files"),
    ("private-folder", "the folder of secrets is the owner's (0700)",
     [("if (::chmod(path.c_str(), 0700) != 0)", 'if (::chmod(path.c_str(), rule_is_out("private-folder") ? 0755 : 0700) != 0)')],
     SECURITY, "test_secrets_are_in_private_files"),
    ("fragment", "the token of a link stands in the fragment",
     [('return impl_->url + "#t="', 'return impl_->url + (rule_is_out("fragment") ? "?t=" : "#t=")'),
      ('std::string()) + "#t="', 'std::string()) + (rule_is_out("fragment") ? "?t=" : "#t=")')],
     SECURITY, "test_the_token_is_in_the_fragment"),
    ("once", "a link signs in once",
     [("if (::unlink(link.c_str()) != 0) return std::nullopt;",
       'if (!rule_is_out("once") && ::unlink(link.c_str()) != 0) return std::nullopt;')],
     SECURITY, "test_the_link_signs_in_once"),
    ("link-life", "a link is good for a day",
     [("if (!made || now - *made > kLinkLife) return std::nullopt;",
       'if (!made || (now - *made > kLinkLife && !rule_is_out("link-life"))) return std::nullopt;')],
     UNIT, "SignInTest.ALinkExpiresAfterADay"),
    ("cookie-life", "a sign-in is good for thirty days",
     [("if (now - stored.began > kCookieLife) {",
       'if (!rule_is_out("cookie-life") && now - stored.began > kCookieLife) {')],
     UNIT, "SignInTest.SignInsSurviveRestartsForThirtyDays"),
    ("http-only", "the cookie is HttpOnly",
     [('return fmt::format("{}={}; Path=/; Max-Age={}; HttpOnly; SameSite=Strict{}", kCookieName, value,\n'
       '                       seconds, secure_cookie ? "; Secure" : "");',
       'return fmt::format("{}={}; Path=/; Max-Age={}{}{}{}", kCookieName, value, seconds,\n'
       '                       rule_is_out("http-only") ? "" : "; HttpOnly", rule_is_out("same-site") ? "" : "; SameSite=Strict",\n'
       '                       secure_cookie && !rule_is_out("secure") ? "; Secure" : "");')],
     SECURITY, "test_the_link_signs_in_once"),
    ("same-site", "the cookie is SameSite=Strict", "http-only", SECURITY, "test_the_link_signs_in_once"),
    ("secure", "with TLS the cookie is Secure", "http-only", SECURITY, "test_tls_with_a_certificate_of_its_own"),
    ("tries", "10 tries a minute to sign in",
     [("const auto wait = tries->refused(request.address, RateLimit::Clock::now());\n               if (wait) {",
       'const auto wait = tries->refused(request.address, RateLimit::Clock::now());\n'
       '               if (wait && !rule_is_out("tries")) {')],
     SECURITY, "test_sign_in_attempts_are_limited"),
    ("bearer-tries", "10 tries a minute with an API token",
     [("if (const auto wait = bearer_tries_.refused(request.address, RateLimit::Clock::now()))",
       'if (const auto wait = bearer_tries_.refused(request.address, RateLimit::Clock::now()); wait && !rule_is_out("bearer-tries"))')],
     SECURITY, "test_sign_in_attempts_are_limited"),
    ("forwarded", "X-Forwarded-For counts behind a proxy alone",
     [("if (behind_proxy()) request.address", 'if (behind_proxy() || rule_is_out("forwarded")) request.address')],
     SECURITY, "test_sign_in_attempts_are_limited"),
    ("constant-time", "secrets are compared in constant time",
     [("bool equals_in_constant_time(std::string_view given, std::string_view secret) {\n",
       "bool equals_in_constant_time(std::string_view given, std::string_view secret) {\n"
       '  if (rule_is_out("constant-time")) return given == secret;\n')],
     UNIT, "SecretsDeathTest.AreComparedToTheEnd"),
    ("sign-in", "the API needs a sign-in",
     [("if (!cookie || !sign_ins_.is_signed_in(*cookie, request.address))",
       'if (rule_is_out("sign-in")) return std::nullopt;\n  if (!cookie || !sign_ins_.is_signed_in(*cookie, request.address))')],
     SECURITY, "test_api_needs_a_sign_in"),
    ("sign-out", "signing out ends the sign-in",
     [("if (cookie) sign_ins.sign_out(*cookie);", 'if (cookie && !rule_is_out("sign-out")) sign_ins.sign_out(*cookie);')],
     SECURITY, "test_the_link_signs_in_once"),
    # Other sites.
    ("host", "a Host that is not ours is refused (DNS rebinding)",
     [("if (!is_own_host(head.host))", 'if (!is_own_host(head.host) && !rule_is_out("host"))')],
     SECURITY, "test_foreign_hosts_are_refused"),
    ("no-host", "a request without Host is refused",
     [("if (!head.has_host || head.host.empty())", 'if ((!head.has_host || head.host.empty()) && !rule_is_out("no-host"))')],
     SECURITY, "test_foreign_hosts_are_refused"),
    ("origin", "an Origin that is not ours is refused",
     [("if (!head.origin.empty() && !is_own_origin(head.origin))",
       'if (!head.origin.empty() && !is_own_origin(head.origin) && !rule_is_out("origin"))')],
     SECURITY, "test_other_sites_are_refused"),
    ("proxy-origin", "behind a proxy: the origin that was configured alone",
     [("if (!proxy_origin.empty() && origin == proxy_origin) return true;",
       'if (!proxy_origin.empty() && (origin == proxy_origin || rule_is_out("proxy-origin"))) return true;')],
     SECURITY, "test_proxy_origin_and_addresses"),
    ("fetch-site", "Sec-Fetch-Site of another site is refused",
     [("      !is_link)\n", '      !is_link && !rule_is_out("fetch-site"))\n')],
     SECURITY, "test_other_sites_are_refused"),
    ("link-to-data", "a link from another site opens pages, never data",
     [('head.method == "GET" && !is_api &&', 'head.method == "GET" && (!is_api || rule_is_out("link-to-data")) &&')],
     SECURITY, "test_other_sites_are_refused"),
    ("link-in-frame", "a link from another site opens no frame and no image",
     [('head.fetch_dest == "document";', '(head.fetch_dest == "document" || rule_is_out("link-in-frame"));'),
      ('head.fetch_mode == "navigate" &&', '(head.fetch_mode == "navigate" || rule_is_out("link-in-frame")) &&')],
     SECURITY, "test_other_sites_are_refused"),
    ("csrf", "changes need the CSRF header",
     [("if (is_change(request.method) &&\n", 'if (is_change(request.method) && !rule_is_out("csrf") &&\n')],
     SECURITY, "test_changes_need_the_csrf_header_and_json"),
    ("json", "a body is JSON by its content type",
     [("if (!options.types.empty() && std::find(", 'if (!options.types.empty() && !rule_is_out("json") && std::find('),
      ('if (content_type != "application/json")', 'if (content_type != "application/json" && !rule_is_out("json"))')],
     SECURITY, "test_changes_need_the_csrf_header_and_json"),
    ("methods", "changes are made by POST, PUT and DELETE",
     [('router.add("DELETE", "/api/viewer-cameras/{id}",',
       'router.add(rule_is_out("methods") ? "GET" : "DELETE", "/api/viewer-cameras/{id}",')],
     SECURITY, "test_get_requests_change_nothing"),
    ("get-body", "a GET request must not have a body",
     [('if (request.method == "GET") return error_response(400, "a GET request must not have a body");',
       'if (request.method == "GET" && !rule_is_out("get-body")) return error_response(400, "a GET request must not have a body");')],
     SECURITY, "test_changes_need_the_csrf_header_and_json"),
    # What a page may do.
    ("policy", "Content-Security-Policy of every answer",
     [('header("Content-Security-Policy", response.file.empty() ? kPolicy : kDataPolicy);',
       'const std::string policy = response.file.empty() || rule_is_out("data-policy") ? kPolicy : kDataPolicy;\n'
       '    if (!rule_is_out("policy"))\n'
       '      header("Content-Security-Policy",\n'
       '             rule_is_out("frame-ancestors") ? policy.substr(0, policy.find("; frame-ancestors")) : policy);')],
     SECURITY, "test_responses_carry_the_policy"),
    ("frame-ancestors", "no other page frames ours (frame-ancestors)", "policy", SECURITY, "test_responses_carry_the_policy"),
    ("data-policy", "a file of the user is sandboxed", "policy", SECURITY, "test_uploads_stay_in_their_folder"),
    header("X-Content-Type-Options", "nosniff", "X-Content-Type-Options: nosniff"),
    header("Referrer-Policy", "referrer", "Referrer-Policy: no-referrer"),
    header("Cross-Origin-Opener-Policy", "opener", "Cross-Origin-Opener-Policy: same-origin"),
    header("Cross-Origin-Resource-Policy", "resource", "Cross-Origin-Resource-Policy: same-origin"),
    header("X-Frame-Options", "frame-options", "X-Frame-Options: DENY"),
    ("permissions", "Permissions-Policy: the own camera alone",
     [('  header("Permissions-Policy",\n', '  if (!rule_is_out("permissions")) header("Permissions-Policy",\n')],
     SECURITY, "test_responses_carry_the_policy"),
    ("no-store", "answers of the API are stored nowhere",
     [('if (!has("Cache-Control")) header(', 'if (!has("Cache-Control") && !rule_is_out("no-store")) header(')],
     SECURITY, "test_responses_carry_the_policy"),
    # Paths and bodies.
    ("dots", "no '..' and no empty segment in a path",
     [('if (!segment || segment->empty() || *segment == "." || *segment == "..") return std::nullopt;',
       'if (!segment) return std::nullopt;\n'
       '    if ((segment->empty() || *segment == "." || *segment == "..") && !rule_is_out("dots")) return std::nullopt;')],
     SECURITY, "test_malformed_paths_and_bodies"),
    ("slashes", "no escaped '/', '\\' or control character in a path",
     [("if (c == '/' || c == '\\\\' || static_cast<unsigned char>(c) < 0x20 || c == 0x7f)",
       "if (rule_is_out(\"slashes\")) continue;\n"
       "      if (c == '/' || c == '\\\\' || static_cast<unsigned char>(c) < 0x20 || c == 0x7f)")],
     SECURITY, "test_malformed_paths_and_bodies"),
    ("query-fields", "a query has 256 fields at most",
     [("if (!key || !value || result.size() >= kMaxQueryFields) return std::nullopt;",
       'if (!key || !value || (result.size() >= kMaxQueryFields && !rule_is_out("query-fields"))) return std::nullopt;')],
     SECURITY, "test_malformed_paths_and_bodies"),
    ("header-fields", "a request has 100 header fields at most",
     [("return headers.size() < 100 ? MHD_YES : MHD_NO;", 'return headers.size() < 100 || rule_is_out("header-fields") ? MHD_YES : MHD_NO;'),
      ("if (count < 0 || request.headers.size() >= 100)", 'if (count < 0 || (request.headers.size() >= 100 && !rule_is_out("header-fields")))')],
     SECURITY, "test_malformed_paths_and_bodies"),
    ("header-bytes", "a request's head has 32 kB at most",
     [("MHD_OPTION_CONNECTION_MEMORY_LIMIT, kHeadBytes,",
       'MHD_OPTION_CONNECTION_MEMORY_LIMIT, rule_is_out("header-bytes") ? std::size_t{1} << 20U : kHeadBytes,')],
     SECURITY, "test_malformed_paths_and_bodies"),
    ("body-bytes", "a body has as many bytes as its address takes",
     [("if (pending.expected > options.max_body)", 'if (pending.expected > options.max_body && !rule_is_out("body-bytes"))')],
     SECURITY, "test_malformed_paths_and_bodies"),
    ("chunked", "a body says its length before it comes",
     [('if (!request.header("transfer-encoding").empty())\n    return error_response(411',
       'if (!request.header("transfer-encoding").empty() && !rule_is_out("chunked"))\n    return error_response(411')],
     SECURITY, "test_malformed_paths_and_bodies"),
    ("nesting", "JSON is nested 32 deep at most",
     [("too_deep = too_deep || depth > 32;", 'too_deep = too_deep || (depth > 32 && !rule_is_out("nesting"));')],
     SECURITY, "test_malformed_paths_and_bodies"),
    # Files.
    ("names", "names of files stay in their folder",
     [("  if (is_good_name(name)) return;\n", '  if (is_good_name(name) || rule_is_out("names")) return;\n')],
     FILES, "FilesTest.test_hostile_names"),
    ("links", "links in the workspace are not followed",
     [("return ::lstat(path.c_str(), &status) == 0 && S_ISREG(status.st_mode);",
       'return (rule_is_out("links") ? ::stat(path.c_str(), &status) : ::lstat(path.c_str(), &status)) == 0 && S_ISREG(status.st_mode);'),
      ("return ::lstat(path.c_str(), &status) == 0 && S_ISDIR(status.st_mode);",
       'return (rule_is_out("links") ? ::stat(path.c_str(), &status) : ::lstat(path.c_str(), &status)) == 0 && S_ISDIR(status.st_mode);')],
     FILES, "FilesTest.test_links_are_not_followed"),
    ("pixels", "an image has 100 million pixels at most (bombs)",
     [("if (pixels <= 0 || pixels > max_pixels) {", 'if (rule_is_out("pixels")) return {};\n    if (pixels <= 0 || pixels > max_pixels) {')],
     FILES, "FilesTest.test_unreadable_images"),
    ("damage", "a damaged image is refused",
     [("!damage.empty()) {", '!damage.empty() && !rule_is_out("damage")) {')],
     FILES, "FilesTest.test_unreadable_images"),
    ("kinds", "files of other kinds are refused",
     [("std::string upload_error(std::string_view name, std::string_view bytes, std::int64_t max_pixels,\n"
       "                         FileType& type) {\n",
       "std::string upload_error(std::string_view name, std::string_view bytes, std::int64_t max_pixels,\n"
       "                         FileType& type) {\n"
       '  if (rule_is_out("kinds") && !image_format_of(bytes_of(bytes))) return {};\n')],
     FILES, "FilesTest.test_unreadable_images"),
    ("foreign-names", "lists that name files elsewhere are refused",
     [("if (!names_foreign_files(bytes)) return {};", 'if (rule_is_out("foreign-names") || !names_foreign_files(bytes)) return {};')],
     FILES, "FilesTest.test_unreadable_images"),
    ("download", "a browser shows images and videos alone: all else is a download",
     [('return std::string(type);\n  }\n  return "application/octet-stream";\n',
       'return std::string(type);\n  }\n  return rule_is_out("download") ? "text/html" : "application/octet-stream";\n')],
     FILES, "FilesTest.test_unreadable_images"),
    ("quota", "the workspace has its quota",
     [("if (now.used + bytes > now.quota) {", 'if (now.used + bytes > now.quota && !rule_is_out("quota")) {')],
     FILES, "KillTest.test_quota"),
    ("file-mode", "uploaded files are the owner's (0600)",
     [("::fchmod(fd, 0600) == 0", '::fchmod(fd, rule_is_out("file-mode") ? 0644 : 0600) == 0')],
     FILES, "FilesTest.test_sets"),
    ("one-server", "one server a workspace",
     [("if (::flock(lock_, LOCK_EX | LOCK_NB) != 0) {", 'if (::flock(lock_, LOCK_EX | LOCK_NB) != 0 && !rule_is_out("one-server")) {')],
     FILES, "KillTest.test_one_server_a_workspace"),
    # Sources and flags.
    ("sources", "a source is one of those that were allowed at the start",
     [('  if (kind == "synth" && !rest.empty()) return reference;\n',
       '  if (rule_is_out("sources") || (kind == "synth" && !rest.empty())) return reference;\n'),
      ("        return add(input_file(name, text));\n      case InputKind::kFile:",
       '        return rule_is_out("sources") ? add(text) : add(input_file(name, text));\n      case InputKind::kFile:')],
     SECURITY, "test_free_sources_and_dangerous_flags_are_refused"),
    ("flags", "a flag that nobody has classified is refused",
     [("if (kind == FlagKind::kRefused || kind == FlagKind::kUnknown) {",
       'if ((kind == FlagKind::kRefused || kind == FlagKind::kUnknown) && !rule_is_out("flags")) {'),
      ('    refuse("{} cannot be given here", name);\n', '    if (rule_is_out("flags")) return value_text(name, value);\n    refuse("{} cannot be given here", name);\n')],
     SECURITY, "test_free_sources_and_dangerous_flags_are_refused"),
    ("values", "a value is no path",
     [("if (text.find_first_of(\"/\\\\~\") != std::string::npos ||", "if (!rule_is_out(\"values\") && (text.find_first_of(\"/\\\\~\") != std::string::npos ||"),
      ('text.find("..") != std::string::npos || text.starts_with("out:")) {', 'text.find("..") != std::string::npos || text.starts_with("out:"))) {')],
     UNIT, "VerbPolicy.ChecksValues"),
    ("outputs", "results go into the job's folder",
     [('    if (!reference.starts_with("out:")) {', '    if (rule_is_out("outputs")) return reference;\n    if (!reference.starts_with("out:")) {')],
     JOBS, "JobsTest.test_verbs_that_are_forbidden"),
    ("verbs", "serve, demo and help are not started from a page",
     [("if (is_refused_verb(request.verb)) refuse", 'if (is_refused_verb(request.verb) && !rule_is_out("verbs")) refuse')],
     JOBS, "JobsTest.test_verbs_that_are_forbidden"),
    ("masks", "passwords of sources are masked",
     [("if (secret.empty()) continue;", 'if (secret.empty() || rule_is_out("masks")) continue;')],
     UNIT, "LiveSession.MasksSecrets"),
    # Limits.
    ("per-address", "64 connections of one address",
     [("if (same > options_.max_per_address) {", 'if (same > options_.max_per_address && !rule_is_out("per-address")) {')],
     SECURITY, "test_200_clients_do_not_block_others"),
    ("connections", "256 connections in all",
     [("} else if (all > options_.max_connections) {", '} else if (all > options_.max_connections && !rule_is_out("connections")) {')],
     SECURITY, "test_200_clients_do_not_block_others"),
    ("patience", "slow heads are closed (slow loris)",
     [("if (now >= connection->deadline) end(*connection);", 'if (now >= connection->deadline && !rule_is_out("patience")) end(*connection);')],
     SECURITY, "test_slow_clients_are_closed"),
    ("sessions", "9 sessions",
     [("if (running >= options_.max_sessions)", 'if (running >= options_.max_sessions && !rule_is_out("sessions"))')],
     LIVE, "test_limits_of_sessions_and_streams"),
    ("streams", "32 streams",
     [("if (count_ >= max_streams_)", 'if (count_ >= max_streams_ && !rule_is_out("streams"))')],
     LIVE, "test_limits_of_sessions_and_streams"),
    ("watched", "16 sessions in a stream",
     [("if (seen.size() > kMaxWatched || id.size() > 64)", 'if ((seen.size() > kMaxWatched || id.size() > 64) && !rule_is_out("watched"))')],
     LIVE, "test_limits_of_sessions_and_streams"),
    ("events", "events are checked: a page sends no orders of the server's own",
     [("  if (!event.is_object()) return std::nullopt;\n",
       '  if (rule_is_out("events")) return event.dump() + "\\n";\n  if (!event.is_object()) return std::nullopt;\n')],
     LIVE, "test_images_states_and_events"),
    ("cameras", "16 cameras of browsers",
     [("if (cameras_.size() >= kMaxCameras)\n", 'if (cameras_.size() >= kMaxCameras && !rule_is_out("cameras"))\n')],
     SECURITY, "test_browsers_have_sixteen_cameras"),
    ("jobs", "500 jobs are kept, 50 wait",
     [("if (jobs_.size() >= options_.max_jobs) {", 'if (jobs_.size() >= options_.max_jobs && !rule_is_out("jobs")) {'),
      ("if (static_cast<std::size_t>(queued) >= options_.max_queued) {",
       'if (static_cast<std::size_t>(queued) >= options_.max_queued && !rule_is_out("jobs")) {')],
     UNIT, "JobsTest.LimitsTheNumberOfJobs"),
    ("slow-reader", "a slow viewer gets fewer images: none waits for it",
     [("  const int unsent = kUnsent;\n", '  if (rule_is_out("slow-reader")) return;\n  const int unsent = kUnsent;\n')],
     SECURITY, "test_a_paused_viewer_gets_new_images"),
    # Stored data.
    ("audit", "sign-in, enrolment, forgetting and export are in the audit log",
     [("  nlohmann::json line = details.is_object() ? details : nlohmann::json::object();\n",
       '  if (rule_is_out("audit")) return;\n  nlohmann::json line = details.is_object() ? details : nlohmann::json::object();\n')],
     JOBS, "JobsTest.test_people_and_plates"),
    ("audit-names", "the audit log holds no names",
     [('details["person_sha256"] = sum.hex();', 'details["person_sha256"] = rule_is_out("audit-names") ? request.inputs.front() : sum.hex();')],
     JOBS, "JobsTest.test_people_and_plates"),
]


class Problem(Exception):
    """A patch without a place, a failed build, or a test with the wrong outcome."""


def patched_sources(rules):
    """{file: text} of the files with these rules, each rule under its condition."""
    # Rules on the same line share the patch of the first one.
    shared = {row[2] for row in rules if isinstance(row[2], str)}
    rules = [row for row in RULES if row in rules or row[0] in shared]
    texts = {}
    for path in [*sorted(glob.glob(os.path.join(SERVER, "*.cpp"))), SERVICE]:
        if not path.endswith("_test.cpp"):
            with open(path, encoding="utf-8") as file:
                texts[path] = file.read()
    changed = {}
    for rule, _, patches, _, _ in rules:
        for old, new in patches if isinstance(patches, list) else []:
            found = [path for path, text in texts.items() for _ in range(text.count(old))]
            if len(found) > 1:
                found = [path for path in found if path != SERVICE]
            if len(found) != 1:
                raise Problem(f"{rule}: {len(found)} places for {old!r}")
            texts[found[0]] = texts[found[0]].replace(old, new)
            changed[found[0]] = True
    return {path: SWITCH + "#line 1\n" + texts[path] for path in changed}


def commands(build, *arguments):
    return subprocess.run(["ninja", "-C", build, "-t", "commands", *arguments], check=True, capture_output=True, text=True).stdout


def run_all(work, jobs):
    """Runs shell commands, two at a time."""
    waiting, running = list(work), []
    while waiting or running:
        while waiting and len(running) < jobs:
            words, folder = waiting.pop(0)
            running.append((words, subprocess.Popen(words, shell=True, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                                    text=True, start_new_session=True)))
        words, first = running.pop(0)
        output = first.communicate()[0]
        if first.returncode != 0:
            raise Problem(f"{words}\n{output}")


def build_scratch(build, scratch, rules, jobs):
    """Builds the server and its unit tests with these rules under their conditions, in scratch/bin."""
    sources = os.path.join(scratch, "server")
    shutil.copytree(SERVER, sources)
    with open(os.path.join(build, "compile_commands.json"), encoding="utf-8") as file:
        known = {entry["file"]: entry for entry in json.load(file)}
    copies = {}
    for path, text in patched_sources(rules).items():
        copies[path] = os.path.join(sources, os.path.basename(path))
        with open(copies[path], "w", encoding="utf-8") as file:
            file.write(text)
    work, objects = [], []
    for path, entry in known.items():
        copy = copies.get(path)
        if os.path.basename(os.path.dirname(path)) == "Unity":
            with open(path, encoding="utf-8") as file:
                text = file.read()
            patched = re.sub(r'(?<=#include ")[^"]+', lambda include: copies.get(include[0], include[0]), text)
            if patched != text:  # it includes patched files
                copy = os.path.join(sources, os.path.basename(path))
                with open(copy, "w", encoding="utf-8") as file:
                    file.write(patched)
        if copy is None:
            continue
        objects.append(copy + ".o")
        words = re.sub(r" -o \S+", f" -o {objects[-1]}", entry["command"]).replace(f"-c {path}", f"-c {copy}")
        work.append((words.replace(f"-I{SERVER}", f"-I{sources} -I{SERVER}", 1), entry["directory"]))
    run_all(work, jobs)
    binaries = os.path.join(scratch, "bin")
    os.makedirs(binaries)
    links = []
    for target in ("tarsier-serve", "web_test"):
        words = commands(build, target).strip().splitlines()[-1]
        # Objects before the archive are linked instead of the archive's own.
        words = words.replace(f"-o bin/{target}", f"-o {os.path.join(binaries, target)}")
        links.append((re.sub(r" (?=apps/web/libtarsier_web\.a)", " " + " ".join(objects) + " ", words, count=1), build))
    run_all(links, jobs)
    # The program looks for its companion in its own folder.
    shutil.copy(os.path.join(build, "bin", "tarsier"), binaries)
    return binaries


def run_test(binaries, file, test, rule, scratch):
    """Whether the test passed, and its output."""
    environment = {**os.environ, "TARSIER_SERVE_BIN": binaries, "TARSIER_RULE_OUT": rule, "TARSIER_WEB_BUILD": scratch, "WORK": scratch,
                   "TARSIER_MODELS": os.path.join(ROOT, "models")}
    if file == UNIT:
        words = [os.path.join(binaries, UNIT), f"--gtest_filter={test}"]
    else:
        words = [sys.executable, "-W", "ignore", os.path.join(HERE, file), test]
    try:
        done = subprocess.run(words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=240, check=False)
    except subprocess.TimeoutExpired as late:
        return False, f"no end in 240 s: {late.stdout}"
    if done.returncode not in (0, 1):
        return False, f"exit status {done.returncode}\n{done.stdout}"
    return done.returncode == 0, done.stdout


def why(output):
    """The line that names the failure."""
    lines = [line.strip() for line in output.splitlines() if re.search(r"^FAIL |AssertionError|^\S*Error: |Failure$|FAILED", line.strip())]
    return lines[0][:160] if lines else output.strip().splitlines()[-1][:160] if output.strip() else "nothing"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--build", default=os.path.join(ROOT, "build", "release"))
    parser.add_argument("--table", help="write the table here, as Markdown")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--check", action="store_true", help="only whether each patch finds its place")
    parser.add_argument("rules", nargs="*", metavar="NAME")
    given = parser.parse_args()
    try:
        sources = patched_sources(RULES)
    except Problem as problem:
        sys.exit(f"rules_removed: {problem}")
    if given.check:
        print(f"{len(RULES)} rules in {len(sources)} files: each patch finds its place")
        return 0
    unknown = set(given.rules) - {row[0] for row in RULES}
    if unknown:
        sys.exit(f"rules_removed: no rule {', '.join(sorted(unknown))}")
    rules = [row for row in RULES if not given.rules or row[0] in given.rules]
    scratch = tempfile.mkdtemp(prefix="tarsier-rules-")
    failed, rows = [], []
    try:
        begin = time.monotonic()
        binaries = build_scratch(os.path.abspath(given.build), scratch, rules, given.jobs)
        print(f"built in {time.monotonic() - begin:.0f} s", flush=True)
        for file, test in dict.fromkeys((row[3], row[4]) for row in rules):
            passed, output = run_test(binaries, file, test, "", scratch)
            if not passed:
                raise Problem(f"{file} {test} fails with all rules in:\n{output}")
        print(f"all tests pass with all rules in ({time.monotonic() - begin:.0f} s)", flush=True)
        for rule, what, _, file, test in rules:
            passed, output = run_test(binaries, file, test, rule, scratch)
            print(f"{'PASSED' if passed else 'failed'}  {rule}: {test}: {'' if passed else why(output)}", flush=True)
            rows.append((what, rule, test.split(".")[-1]))
            if passed:
                failed.append(rule)
    except Problem as problem:
        sys.exit(f"rules_removed: {problem}")
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    if given.table:
        with open(given.table, "w", encoding="utf-8") as file:
            file.write("| Rule | Taken out as | Test that fails then |\n|---|---|---|\n")
            file.writelines(f"| {what} | `{rule}` | `{test}` |\n" for what, rule, test in rows)
    print(f"{len(rows) - len(failed)} of {len(rows)} rules: the test fails without them ({time.monotonic() - begin:.0f} s)")
    if failed:
        print("no test noticed that these were out: " + ", ".join(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
