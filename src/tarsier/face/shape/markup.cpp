// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/face/shape/markup_check.h"

#include <cstdint>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>
#include <utility>

namespace tarsier::face::shape {
namespace {

using nlohmann::json;
using Connections = std::vector<std::array<int, 2>>;

void add_chain(Connections& connections, int first, int last) {
  for (int i = first; i < last; ++i) connections.push_back({i, i + 1});
}

void add_loop(Connections& connections, int first, int last) {
  add_chain(connections, first, last);
  connections.push_back({last, first});
}

std::vector<int> mirror_of(int points, std::initializer_list<std::pair<int, int>> pairs) {
  std::vector<int> mirror(static_cast<std::size_t>(points));
  std::iota(mirror.begin(), mirror.end(), 0);
  for (const auto& [a, b] : pairs) {
    mirror[static_cast<std::size_t>(a)] = b;
    mirror[static_cast<std::size_t>(b)] = a;
  }
  return mirror;
}

// Sagonas et al., "300 faces in-the-wild challenge", ICCV workshops 2013.
Markup markup_68() {
  Markup markup;
  markup.mirror =
      mirror_of(68, {{0, 16},  {1, 15},  {2, 14},  {3, 13},  {4, 12},  {5, 11},  {6, 10},  {7, 9},
                     {17, 26}, {18, 25}, {19, 24}, {20, 23}, {21, 22}, {31, 35}, {32, 34}, {36, 45},
                     {37, 44}, {38, 43}, {39, 42}, {40, 47}, {41, 46}, {48, 54}, {49, 53}, {50, 52},
                     {55, 59}, {56, 58}, {60, 64}, {61, 63}, {65, 67}});
  add_chain(markup.connections, 0, 16);
  add_chain(markup.connections, 17, 21);
  add_chain(markup.connections, 22, 26);
  add_chain(markup.connections, 27, 30);
  add_chain(markup.connections, 31, 35);
  add_loop(markup.connections, 36, 41);
  add_loop(markup.connections, 42, 47);
  add_loop(markup.connections, 48, 59);
  add_loop(markup.connections, 60, 67);
  markup.outer_eyes = {36, 45};
  return markup;
}

// Fagertun and Stegmann, "The IMM frontal face database", DTU 2005.
Markup markup_73() {
  Markup markup;
  markup.mirror = mirror_of(
      73, {{0, 8},   {1, 15},  {2, 14},  {3, 13},  {4, 12},  {5, 11},  {6, 10},  {7, 9},   {16, 24},
           {17, 31}, {18, 30}, {19, 29}, {20, 28}, {21, 27}, {22, 26}, {23, 25}, {32, 33}, {34, 44},
           {35, 43}, {36, 42}, {37, 41}, {38, 40}, {46, 52}, {47, 51}, {48, 50}, {53, 55}, {56, 58},
           {59, 61}, {62, 72}, {63, 71}, {64, 70}, {65, 69}, {66, 68}});
  add_loop(markup.connections, 0, 7);
  add_loop(markup.connections, 8, 15);
  add_loop(markup.connections, 16, 23);
  add_loop(markup.connections, 24, 31);
  add_chain(markup.connections, 34, 44);
  add_loop(markup.connections, 46, 55);
  add_chain(markup.connections, 56, 58);
  add_chain(markup.connections, 59, 61);
  add_chain(markup.connections, 62, 72);
  markup.outer_eyes = {16, 24};
  return markup;
}

// Milborrow, Morkel and Nicolls, "The MUCT landmarked face database", PRASA 2010: XM2VTS's 68
// points (the eyebrows run from the outer end along the top and back along the bottom) and four
// more per eye.
Markup markup_76() {
  Markup markup;
  markup.mirror = mirror_of(
      76, {{0, 14},  {1, 13},  {2, 12},  {3, 11},  {4, 10},  {5, 9},   {6, 8},   {15, 21}, {16, 22},
           {17, 23}, {18, 24}, {19, 25}, {20, 26}, {27, 32}, {28, 33}, {29, 34}, {30, 35}, {31, 36},
           {37, 45}, {38, 44}, {39, 43}, {40, 42}, {46, 47}, {48, 54}, {49, 53}, {50, 52}, {55, 59},
           {56, 58}, {60, 62}, {63, 65}, {68, 72}, {69, 73}, {70, 74}, {71, 75}});
  add_chain(markup.connections, 0, 14);
  add_loop(markup.connections, 15, 20);
  add_loop(markup.connections, 21, 26);
  for (const int eye : {0, 1}) {
    // Corners and lids, with the points from 68 on between them.
    for (int k = 0; k < 4; ++k) {
      const int first = 27 + 5 * eye;
      const int between = 68 + 4 * eye + k;
      markup.connections.push_back({first + k, between});
      markup.connections.push_back({between, first + (k + 1) % 4});
    }
  }
  add_chain(markup.connections, 37, 45);
  add_loop(markup.connections, 48, 59);
  add_loop(markup.connections, 60, 65);
  markup.outer_eyes = {27, 32};
  return markup;
}

int index_from_json(const json& value, const std::string& path, const char* what, int points) {
  if (!value.is_number_integer())
    throw ModelError(path, fmt::format("'{}': expected only whole numbers", what));
  const bool beyond = value.is_number_unsigned() && value.get<std::uint64_t>() > 1'000'000'000U;
  const std::int64_t index = beyond ? -1 : value.get<std::int64_t>();
  if (index < 0 || index >= points) {
    throw ModelError(path, fmt::format("'{}' has index {}, but there are {} points", what,
                                       value.dump(), points));
  }
  return static_cast<int>(index);
}

const json* list_or_none(const json& object, const std::string& path, const char* name) {
  const auto found = object.find(name);
  if (found == object.end()) return nullptr;
  if (!found->is_array()) throw ModelError(path, fmt::format("'{}': expected a list", name));
  return &*found;
}

}  // namespace

void check_mirror(const std::vector<int>& mirror, int points) {
  if (mirror.empty()) return;
  TARSIER_REQUIRE(mirror.size() == static_cast<std::size_t>(points),
                  "a mirror of {} points for {} points", mirror.size(), points);
  for (int i = 0; i < points; ++i) {
    const int other = mirror[static_cast<std::size_t>(i)];
    TARSIER_REQUIRE(other >= 0 && other < points, "the mirror of point {} is {}", i, other);
    TARSIER_REQUIRE(mirror[static_cast<std::size_t>(other)] == i,
                    "the mirror of point {} is {}, whose mirror is {}", i, other,
                    mirror[static_cast<std::size_t>(other)]);
  }
}

void check_connections(const std::vector<std::array<int, 2>>& connections, int points) {
  for (const auto& [a, b] : connections) {
    TARSIER_REQUIRE(a >= 0 && a < points && b >= 0 && b < points,
                    "a connection of {} and {}, but there are {} points", a, b, points);
  }
}

std::vector<int> mirror_from_json(const json& object, const std::string& path, int points) {
  std::vector<int> mirror;
  const json* list = list_or_none(object, path, "mirror");
  if (list == nullptr) return mirror;
  for (const json& item : *list) mirror.push_back(index_from_json(item, path, "mirror", points));
  try {
    check_mirror(mirror, points);
  } catch (const std::invalid_argument&) {
    throw ModelError(path, "'mirror' does not pair the points");
  }
  return mirror;
}

std::vector<std::array<int, 2>> connections_from_json(const json& object, const std::string& path,
                                                      int points) {
  Connections connections;
  const json* list = list_or_none(object, path, "connections");
  if (list == nullptr) return connections;
  for (const json& item : *list) {
    if (!item.is_array() || item.size() != 2)
      throw ModelError(path, "'connections': expected only pairs");
    connections.push_back({index_from_json(item[0], path, "connections", points),
                           index_from_json(item[1], path, "connections", points)});
  }
  return connections;
}

std::optional<Markup> known_markup(int points) {
  switch (points) {
    case 68:
      return markup_68();
    case 73:
      return markup_73();
    case 76:
      return markup_76();
    default:
      return std::nullopt;
  }
}

}  // namespace tarsier::face::shape
