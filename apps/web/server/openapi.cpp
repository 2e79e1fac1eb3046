// SPDX-License-Identifier: MIT
#include "openapi.h"

#include <fmt/format.h>

#include "router.h"
#include "runs.h"
#include "verb_policy.h"
#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>

namespace tarsier::web {
namespace {

using OrderedJson = nlohmann::ordered_json;

// The description of a route. `curl` follows "curl -sS --fail-with-body $AUTH". Its path uses
// example names: the set holiday, the file photo.jpg, the job $JOB, the session $SESSION.
struct RouteText {
  std::string_view route;
  std::string_view tag;
  std::string_view summary;
  std::string_view curl;
  std::string_view body;    // schema of the request's JSON
  std::string_view answer;  // schema of the response; "" for none, "text", "binary"
  int status = 200;
};

constexpr auto kRoutes = std::to_array<RouteText>({
    {"GET /api/session", "sign-in", "Whether the request is signed in", "$TARSIER_URL/api/session",
     "", "object"},
    {"POST /api/session", "sign-in", "Exchange the token of a link for a cookie",
     R"(-X POST --json '{"token":"FROM_THE_LINK"}' $TARSIER_URL/api/session)", "object", "object"},
    {"DELETE /api/session", "sign-in", "Sign out", "-X DELETE $TARSIER_URL/api/session", "", "",
     204},
    {"GET /api/sign-ins", "sign-in", "Who is signed in, and when the token for programs was made",
     "$TARSIER_URL/api/sign-ins", "", "object"},
    {"DELETE /api/sign-ins/{id}", "sign-in", "End a sign-in",
     "-X DELETE $TARSIER_URL/api/sign-ins/$SIGN_IN", "", "", 204},
    {"DELETE /api/sign-ins", "sign-in", "End all sign-ins but the request's own, and unused links",
     "-X DELETE $TARSIER_URL/api/sign-ins", "", "object"},
    {"POST /api/api-token", "sign-in",
     "Make a new token for programs, only from a browser; the old token becomes invalid",
     "-X POST --json '{}' $TARSIER_URL/api/api-token", "object", "object"},
    {"GET /healthz", "studio", "Whether the server is running; needs no sign-in",
     "$TARSIER_URL/healthz", "", "object"},
    {"GET /metrics", "studio", "Metrics for Prometheus", "$TARSIER_URL/metrics", "", "text"},
    {"GET /api/info", "studio", "Version, machine, workspace, limits", "$TARSIER_URL/api/info", "",
     "object"},
    {"GET /api/help", "studio", "All verbs with their flags", "$TARSIER_URL/api/help", "", "Help"},
    {"GET /api/openapi.json", "studio", "This description", "$TARSIER_URL/api/openapi.json", "",
     "object"},
    {"GET /api/audit", "studio", "Sign-ins, enrolments, deletions and exports, newest last",
     "$TARSIER_URL/api/audit?count=20", "", "object"},
    {"GET /api/sources", "live", "Sources that sessions can use", "$TARSIER_URL/api/sources", "",
     "object"},
    {"GET /api/sessions", "live", "Live sessions", "$TARSIER_URL/api/sessions", "", "object"},
    {"POST /api/sessions", "live", "Start a live session",
     R"(-X POST --json '{"verb":"cartoon run","inputs":["synth:portrait?live=1"],"flags":{"--mode":"sketch"}}' $TARSIER_URL/api/sessions)",
     "Start", "Session", 201},
    {"GET /api/sessions/{id}", "live", "A live session", "$TARSIER_URL/api/sessions/$SESSION", "",
     "Session"},
    {"DELETE /api/sessions/{id}", "live", "End a live session",
     "-X DELETE $TARSIER_URL/api/sessions/$SESSION", "", "", 204},
    {"POST /api/sessions/{id}/events", "live", "Keys, mouse, actions, sliders",
     R"(-X POST --json '[{"action":"help"}]' $TARSIER_URL/api/sessions/$SESSION/events)", "events",
     "", 204},
    {"GET /api/sessions/{id}/snapshot.jpg", "live", "The newest image",
     "-o snapshot.jpg $TARSIER_URL/api/sessions/$SESSION/snapshot.jpg", "", "binary"},
    {"GET /api/sessions/{id}/stream.mjpg", "live", "The images as motion JPEG, for other programs",
     "-m 2 -o stream.mjpg $TARSIER_URL/api/sessions/$SESSION/stream.mjpg", "", "binary"},
    {"GET /api/sessions/{id}/stages", "live",
     "The stage images of a frame: its number, the length of a list, the list, the JPEGs",
     "-o stages.bin $TARSIER_URL/api/sessions/$SESSION/stages", "", "binary"},
    {"GET /api/live", "live", "Images, states and jobs as one stream of records",
     "-m 2 -o live.bin \"$TARSIER_URL/api/live?s=$SESSION:640&jobs=1\"", "", "binary"},
    {"POST /api/viewer-cameras", "live", "Make the viewer's own camera a source",
     "-X POST --json '{}' $TARSIER_URL/api/viewer-cameras", "object", "object", 201},
    {"POST /api/viewer-cameras/{id}/frame", "live", "The newest frame of that camera",
     "-X POST -H 'Content-Type: image/jpeg' --data-binary @photo.jpg "
     "$TARSIER_URL/api/viewer-cameras/$VIEWER/frame",
     "image", "", 204},
    {"DELETE /api/viewer-cameras/{id}", "live", "Close that camera",
     "-X DELETE $TARSIER_URL/api/viewer-cameras/$VIEWER", "", "", 204},
    {"GET /api/sets", "files", "All sets of files", "$TARSIER_URL/api/sets", "", "object"},
    {"POST /api/sets", "files", "Make a set",
     R"(-X POST --json '{"name":"holiday"}' $TARSIER_URL/api/sets)", "object", "Set", 201},
    {"GET /api/sets/{name}", "files", "A set and its files", "$TARSIER_URL/api/sets/holiday", "",
     "object"},
    {"DELETE /api/sets/{name}", "files", "Delete a set with its files",
     "-X DELETE $TARSIER_URL/api/sets/holiday", "", "", 204},
    {"PUT /api/sets/{name}/files/{file}", "files",
     "Store a file; an existing file of that name is replaced",
     "-T photo.jpg $TARSIER_URL/api/sets/holiday/files/photo.jpg", "image", "File", 201},
    {"POST /api/sets/{name}/files", "files", "Store files of a form; no file is replaced",
     "-F file=@photo.jpg $TARSIER_URL/api/sets/holiday/files", "form", "object", 201},
    {"GET /api/sets/{name}/files/{file}", "files", "A file, or with ?width= a thumbnail",
     "-o thumbnail.jpg \"$TARSIER_URL/api/sets/holiday/files/photo.jpg?width=320\"", "", "binary"},
    {"DELETE /api/sets/{name}/files/{file}", "files", "Delete a file",
     "-X DELETE $TARSIER_URL/api/sets/holiday/files/photo.jpg", "", "", 204},
    {"GET /api/state", "files", "Permanent files of the workspace, shared by verbs",
     "$TARSIER_URL/api/state", "", "object"},
    {"GET /api/state/{name}", "files", "A file of the workspace",
     "-o camera.yaml $TARSIER_URL/api/state/camera.yaml", "", "binary"},
    {"DELETE /api/state/{name}", "files", "Delete a file of the workspace",
     "-X DELETE $TARSIER_URL/api/state/camera.yaml", "", "", 204},
    {"POST /api/run", "verbs", "Run a verb that finishes within a minute",
     R"(-X POST --json '{"verb":"landmarks fit","inputs":["set:holiday/photo.jpg"]}' $TARSIER_URL/api/run)",
     "Start", "Run"},
    {"GET /api/jobs", "jobs", "All jobs, newest first, without their lines and files",
     "$TARSIER_URL/api/jobs", "", "object"},
    {"POST /api/jobs", "jobs", "Start a job",
     R"(-X POST --json '{"verb":"sfm reconstruct","inputs":["set:holiday"],"flags":{"--output":"out:model"}}' $TARSIER_URL/api/jobs)",
     "Start", "Job", 201},
    {"GET /api/jobs/{id}", "jobs", "A job", "$TARSIER_URL/api/jobs/$JOB", "", "Job"},
    {"DELETE /api/jobs/{id}", "jobs", "Delete a job that has ended, with its results",
     "-X DELETE $TARSIER_URL/api/jobs/$JOB", "", "", 204},
    {"POST /api/jobs/{id}/cancel", "jobs", "Cancel a job",
     "-X POST --json '{}' $TARSIER_URL/api/jobs/$JOB/cancel", "object", "Job", 202},
    {"POST /api/jobs/{id}/again", "jobs", "Start a job again; an interrupted job resumes",
     "-X POST --json '{}' $TARSIER_URL/api/jobs/$JOB/again", "object", "Job", 201},
    {"GET /api/jobs/{id}/log", "jobs", "The log of the verb", "$TARSIER_URL/api/jobs/$JOB/log", "",
     "text"},
    {"GET /api/jobs/{id}/lines", "jobs", "All its JSON lines", "$TARSIER_URL/api/jobs/$JOB/lines",
     "", "text"},
    {"GET /api/jobs/{id}/files/{path}", "jobs",
     "A result file, or with ?width= a thumbnail of an image",
     "-o drawn.png $TARSIER_URL/api/jobs/$JOB/files/drawn.png", "", "binary"},
});

// "/api/jobs/{id}/files/{path...}" in the notation of OpenAPI.
std::string openapi_path(std::string_view pattern) {
  std::string path(pattern);
  if (const std::size_t dots = path.find("...}"); dots != std::string::npos) path.erase(dots, 3);
  return path;
}

const RouteText* find_text(const std::string& method, std::string_view pattern) {
  const std::string name = method + ' ' + openapi_path(pattern);
  const auto found = std::find_if(kRoutes.begin(), kRoutes.end(),
                                  [&](const RouteText& row) { return row.route == name; });
  return found == kRoutes.end() ? nullptr : &*found;
}

bool is_interface(std::string_view pattern) {
  return pattern.starts_with("/api/") || pattern == "/metrics" || pattern == "/healthz";
}

OrderedJson reference(std::string_view schema) {
  if (schema == "object") return {{"type", "object"}};
  if (schema == "events") return {{"type", "array"}, {"items", {{"type", "object"}}}};
  return {{"$ref", fmt::format("#/components/schemas/{}", schema)}};
}

OrderedJson content_of(std::string_view schema) {
  if (schema == "text") return {{"text/plain", {{"schema", {{"type", "string"}}}}}};
  if (schema == "binary" || schema == "image") {
    return {{schema == "image" ? "image/*" : "application/octet-stream",
             OrderedJson{{"schema", OrderedJson::object()}}}};
  }
  if (schema == "form") {
    return {{"multipart/form-data",
             {{"schema",
               {{"type", "object"},
                {"properties",
                 {{"file",
                   {{"type", "string"}, {"contentMediaType", "application/octet-stream"}}}}}}}}}};
  }
  return {{"application/json", {{"schema", reference(schema)}}}};
}

OrderedJson samples(std::string_view curl, bool is_public = false) {
  const std::string_view key = is_public ? "" : "-H \"Authorization: Bearer $TARSIER_TOKEN\" ";
  return OrderedJson::array(
      {{{"lang", "Shell"},
        {"label", "curl"},
        {"source", fmt::format("curl -sS --fail-with-body {}{}", key, curl)}}});
}

OrderedJson path_parameters(std::string_view path) {
  OrderedJson parameters = OrderedJson::array();
  for (std::size_t at = path.find('{'); at != std::string_view::npos; at = path.find('{', at + 1)) {
    const std::size_t end = path.find('}', at);
    parameters.push_back({{"name", path.substr(at + 1, end - at - 1)},
                          {"in", "path"},
                          {"required", true},
                          {"schema", {{"type", "string"}}}});
  }
  return parameters;
}

void add_errors(OrderedJson& responses) {
  for (const char* status : {"400", "401", "404"}) {
    responses[status] = {{"$ref", "#/components/responses/Error"}};
  }
}

// ---- Schemas

OrderedJson number() { return {{"type", "number"}}; }
OrderedJson text() { return {{"type", "string"}}; }
OrderedJson numbers(int count) {
  OrderedJson list = {{"type", "array"}, {"items", number()}};
  if (count > 0) list["minItems"] = list["maxItems"] = count;
  return list;
}
OrderedJson points(int count = 0) {
  OrderedJson list = {{"type", "array"}, {"items", numbers(2)}};
  if (count > 0) list["minItems"] = list["maxItems"] = count;
  return list;
}
OrderedJson list_of(OrderedJson items) { return {{"type", "array"}, {"items", std::move(items)}}; }
OrderedJson object_of(OrderedJson properties, std::vector<std::string> required = {}) {
  OrderedJson object = {{"type", "object"}, {"properties", std::move(properties)}};
  if (!required.empty()) object["required"] = required;
  return object;
}
// A line of a verb's output, about an image or a frame.
OrderedJson line_of(const char* what, OrderedJson item) {
  return object_of({{"image", text()},
                    {"frame", {{"type", "integer"}}},
                    {"time", number()},
                    {what, list_of(std::move(item))},
                    {"ms", number()}},
                   {what});
}

OrderedJson face(bool has_pose) {
  OrderedJson properties = {{"box", numbers(4)}, {"points", points()}, {"score", number()}};
  if (has_pose) {
    properties["rotation"] = numbers(9);
    properties["translation"] = numbers(3);
    for (const char* angle : {"yaw", "pitch", "roll"}) {
      properties[angle] = number();
      properties[std::string(angle) + "_sigma_deg"] = number();
    }
    properties["sigma_floor_deg"] = numbers(3);
  }
  return object_of(std::move(properties));
}

OrderedJson schemas() {
  OrderedJson all;
  all["Error"] = object_of({{"error", text()}}, {"error"});
  all["File"] = object_of({{"name", text()},
                           {"bytes", {{"type", "integer"}}},
                           {"kind", {{"enum", {"image", "video", "other"}}}},
                           {"modified", number()},
                           {"width", {{"type", "integer"}}},
                           {"height", {{"type", "integer"}}}},
                          {"name", "bytes", "kind"});
  all["Set"] = object_of(
      {{"name", text()}, {"files", {{"type", "integer"}}}, {"bytes", {{"type", "integer"}}}},
      {"name"});
  all["Help"] = object_of(
      {{"program", text()},
       {"version", text()},
       {"verbs",
        list_of(object_of(
            {{"verb", text()},
             {"path", list_of(text())},
             {"inputs", list_of({{"type", "object"}})},
             {"flags", list_of({{"type", "object"}})},
             {"needs_output",
              {{"type", "array"},
               {"items", text()},
               {"description",
                "the verb opens a window unless it writes a file: a run or a job must have one of "
                "these flags; if the list is empty, the verb works only in a live session"}}}},
            {"verb", "path", "inputs", "flags"}))}},
      {"verbs"});
  all["Start"] = object_of(
      {{"verb", {{"type", "string"}, {"examples", {"plate read"}}}},
       {"inputs",
        {{"type", "array"},
         {"items", text()},
         {"description",
          "set:NAME, set:NAME/FILE, job:ID/PATH, ws:NAME, model:NAME, synth:NAME?key=value, "
          "camera:N, allowed:NAME; or a name"}}},
       {"flags",
        {{"type", "object"}, {"description", "by the names of /api/help; results are out:NAME"}}},
       {"name", text()}},
      {"verb"});
  all["Run"] = object_of(
      {{"exit", {{"type", "integer"}}},
       {"lines", list_of({{"type", "object"}})},
       {"error", {{"type", {"string", "null"}}}},
       {"ms", number()},
       {"command", text()},
       {"files", list_of(object_of(
                     {{"name", text()}, {"bytes", {{"type", "integer"}}}, {"base64", text()}}))}},
      {"exit", "lines"});
  all["Job"] = object_of(
      {{"id", text()},
       {"verb", text()},
       {"inputs", list_of(text())},
       {"flags", {{"type", "object"}}},
       {"name", text()},
       {"command", text()},
       {"state", {{"enum", {"queued", "running", "done", "failed", "cancelled", "interrupted"}}}},
       {"progress", {{"type", {"object", "null"}}}},
       {"created", number()},
       {"started", {{"type", {"number", "null"}}}},
       {"ended", {{"type", {"number", "null"}}}},
       {"exit", {{"type", {"integer", "null"}}}},
       {"error", {{"type", {"string", "null"}}}},
       {"lines", list_of({{"type", "object"}})},
       {"files", list_of(reference("File"))}},
      {"id", "verb", "state"});
  all["Session"] = object_of({{"id", text()},
                              {"verb", text()},
                              {"name", text()},
                              {"inputs", list_of(text())},
                              {"flags", {{"type", "object"}}},
                              {"command", text()},
                              {"running", {{"type", "boolean"}}},
                              {"error", {{"type", {"string", "null"}}}}},
                             {"id", "verb"});
  all["Plates"] = line_of(
      "plates", object_of({{"text", text()},
                           {"confidence", number()},
                           {"box", numbers(4)},
                           {"corners", points(4)},
                           {"candidates",
                            list_of(object_of({{"text", text()}, {"confidence", number()}}))}}));
  all["Faces"] = line_of("faces", face(false));
  all["Pose"] = line_of("faces", face(true));
  all["People"] = line_of("faces", object_of({{"box", numbers(4)},
                                              {"label", {{"type", {"string", "null"}}}},
                                              {"confidence", number()},
                                              {"known", {{"type", "boolean"}}},
                                              {"trusted", {{"type", "boolean"}}}}));
  all["Markers"] = line_of("markers", object_of({{"id", {{"type", "integer"}}},
                                                 {"corners", points(4)},
                                                 {"rvec", numbers(3)},
                                                 {"tvec", numbers(3)},
                                                 {"name", text()},
                                                 {"homography", numbers(9)}}));
  all["Line"] = {{"type", "object"}};
  return all;
}

std::string_view schema_of(std::string_view verb) {
  constexpr auto kSchemas = std::to_array<std::pair<std::string_view, std::string_view>>({
      {"ar markers", "Markers"},
      {"ar target-track", "Markers"},
      {"landmarks fit", "Faces"},
      {"aam fit", "Faces"},
      {"people identify", "People"},
      {"plate read", "Plates"},
      {"pose track", "Pose"},
  });
  for (const auto& [name, schema] : kSchemas) {
    if (name == verb) return schema;
  }
  return "Line";
}

// ---- Verbs

OrderedJson flag_schema(const nlohmann::json& flag) {
  const std::string type = flag.at("type");
  OrderedJson schema = {{"type", type == "switch" ? "boolean" : type == "text" ? "string" : type}};
  if (!flag.at("choices").empty()) schema["enum"] = flag.at("choices");
  if (const nlohmann::json& range = flag.at("range"); range.is_object()) {
    const bool above = range.value("min_excluded", false);
    const bool below = range.value("max_excluded", false);
    if (range.at("min").is_number())
      schema[above ? "exclusiveMinimum" : "minimum"] = range.at("min");
    if (range.at("max").is_number())
      schema[below ? "exclusiveMaximum" : "maximum"] = range.at("max");
  }
  if (!flag.at("default").is_null()) schema["default"] = flag.at("default");
  const std::size_t least = flag.at("values");
  if (flag.at("repeatable").get<bool>() || least > 1) return list_of(std::move(schema));
  return schema;
}

// The query that a verb's example needs in addition to its image.
std::string_view example_query(std::string_view verb) {
  if (verb == "calibrate") return "?board=chess:9x6&square=25mm";
  if (verb == "people enroll") return "?NAME=Ann&note=agreed&any-quality=true";
  if (verb == "people verify") return "?NAME=Ann";
  if (verb == "ar target-track") return "?target=ws:cover.target.json";
  if (verb == "cartoon run") return "?mode=sketch";
  return "";
}

// The files of the example: calibration needs several of a board, targets need an image of the
// target.
std::string_view example_body(std::string_view verb) {
  if (verb == "calibrate")
    return "-F file=@board1.jpg -F file=@board2.jpg -F file=@board3.jpg -F file=@board4.jpg";
  if (verb == "plate read") return "-X POST -H 'Content-Type: image/jpeg' --data-binary @car.jpg";
  if (verb == "ar markers" || verb == "ar target-track")
    return "-X POST -H 'Content-Type: image/jpeg' --data-binary @desk.jpg";
  return "-X POST -H 'Content-Type: image/jpeg' --data-binary @photo.jpg";
}

void add_verb(OrderedJson& paths, const nlohmann::json& verb) {
  const std::string name = verb.at("verb");
  std::string path = "/api/v1";
  for (const auto& word : verb.at("path")) path += '/' + word.get<std::string>();
  OrderedJson parameters = OrderedJson::array();
  for (const auto& input : verb.at("inputs")) {
    const std::string word = input.at("names").front();
    if (input_kind(name, word) != InputKind::kFreeText) continue;
    parameters.push_back({{"name", word},
                          {"in", "query"},
                          {"required", input.at("required")},
                          {"description", input.at("help")},
                          {"schema", text()}});
  }
  for (const auto& flag : verb.at("flags")) {
    const std::string full = flag.at("names").front();
    const FlagKind kind = flag_kind(name, full);
    const bool is_open = kind == FlagKind::kValue || kind == FlagKind::kFreeText ||
                         kind == FlagKind::kInput || kind == FlagKind::kWordOrInput ||
                         kind == FlagKind::kState;
    if (!is_open) continue;
    parameters.push_back({{"name", full.substr(2)},
                          {"in", "query"},
                          {"required", flag.at("required")},
                          {"description", flag.at("help")},
                          {"schema", flag_schema(flag)}});
  }
  OrderedJson responses;
  responses["200"] = {{"description", "the verb's object; of several images {\"lines\": [..]}"},
                      {"content", content_of(schema_of(name))}};
  const nlohmann::json* output = VerbTable::find_flag(verb, "--output");
  const bool draws =
      output != nullptr && output->at("help").get<std::string>().starts_with("image");
  if (draws) {
    responses["200"]["content"]["image/png"] = {{"schema", OrderedJson::object()}};
    responses["200"]["content"]["image/jpeg"] = {{"schema", OrderedJson::object()}};
  }
  add_errors(responses);
  for (const char* status : {"415", "422", "429", "504"})
    responses[status] = {{"$ref", "#/components/responses/Error"}};
  const std::string address = fmt::format("\"$TARSIER_URL{}{}\"", path, example_query(name));
  OrderedJson code = samples(fmt::format("{} {}", example_body(name), address));
  if (draws) {
    code.push_back(samples(
        fmt::format("{} -H 'Accept: image/png' -o drawn.png {}", example_body(name), address))[0]);
  }
  paths[path]["post"] = {{"tags", {"verbs"}},
                         {"operationId", "v1 " + name},
                         {"summary", verb.at("help")},
                         {"parameters", std::move(parameters)},
                         {"requestBody",
                          {{"required", true},
                           {"content",
                            {{"image/*", {{"schema", OrderedJson::object()}}},
                             {"multipart/form-data", {{"schema", {{"type", "object"}}}}}}}}},
                         {"responses", std::move(responses)},
                         {"x-codeSamples", std::move(code)}};
}

void add_route(OrderedJson& paths, const Router::Route& route) {
  const RouteText* row = find_text(route.method, route.pattern);
  if (row == nullptr) return;
  const std::string path = openapi_path(route.pattern);
  std::string method = route.method;
  std::transform(method.begin(), method.end(), method.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const std::string status = std::to_string(row->status);
  OrderedJson responses;
  responses[status] = {{"description", row->answer.empty() ? "done" : "the response"}};
  if (!row->answer.empty()) responses[status]["content"] = content_of(row->answer);
  add_errors(responses);
  OrderedJson operation = {{"tags", {row->tag}},
                           {"operationId", row->route},
                           {"summary", row->summary},
                           {"parameters", path_parameters(path)}};
  if (!row->body.empty())
    operation["requestBody"] = {{"required", true}, {"content", content_of(row->body)}};
  operation["responses"] = std::move(responses);
  operation["x-codeSamples"] = samples(row->curl, route.access == Access::kPublic);
  if (route.access == Access::kPublic) operation["security"] = OrderedJson::array();
  paths[path][method] = std::move(operation);
}

}  // namespace

nlohmann::json openapi_json(const VerbTable& verbs, const Router& router,
                            std::string_view version) {
  OrderedJson paths = OrderedJson::object();
  for (const Router::Route* route : router.routes()) add_route(paths, *route);
  for (const std::string& name : image_verbs()) {
    if (const nlohmann::json* verb = verbs.find(name)) add_verb(paths, *verb);
  }
  const OrderedJson document = {
      {"openapi", "3.1.0"},
      {"info",
       {{"title", "Tarsier studio"},
        {"version", version},
        {"license", {{"name", "MIT"}}},
        {"description",
         "Before the examples: export TARSIER_URL=http://127.0.0.1:8765 "
         "TARSIER_TOKEN=$(cat ~/.local/share/tarsier/.studio/api-token)"}}},
      {"servers", OrderedJson::array({{{"url", "/"}}})},
      {"security",
       OrderedJson::array({{{"token", OrderedJson::array()}}, {{"cookie", OrderedJson::array()}}})},
      {"paths", std::move(paths)},
      {"components",
       {{"securitySchemes",
         {{"token", {{"type", "http"}, {"scheme", "bearer"}}},
          {"cookie", {{"type", "apiKey"}, {"in", "cookie"}, {"name", "tarsier_session"}}}}},
        {"responses",
         {{"Error",
           {{"description", "what is wrong, and what to do"}, {"content", content_of("Error")}}}}},
        {"schemas", schemas()}}}};
  return document;
}

std::vector<std::string> undescribed_routes(const Router& router) {
  std::vector<std::string> missing;
  for (const Router::Route* route : router.routes()) {
    const bool is_v1 = route->pattern.starts_with("/api/v1/");
    if (is_interface(route->pattern) && !is_v1 &&
        find_text(route->method, route->pattern) == nullptr) {
      missing.push_back(route->method + ' ' + route->pattern);
    }
  }
  return missing;
}

}  // namespace tarsier::web
