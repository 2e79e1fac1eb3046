// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/align.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/words.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string_view>

namespace tarsier::sfm {
namespace {

constexpr std::int64_t kMaxFileBytes = 100'000'000;
constexpr double kMaxCoordinate = 1e12;
constexpr std::size_t kMaxTriples = 1000;
constexpr int kMaxRefits = 20;

// The upper median, but never only of the three pairs that fit by construction.
double score_of(std::vector<double> residuals) {
  const std::size_t rank =
      std::min(residuals.size() - 1, std::max<std::size_t>(3, residuals.size() / 2));
  std::nth_element(residuals.begin(), residuals.begin() + static_cast<std::ptrdiff_t>(rank),
                   residuals.end());
  return residuals[rank];
}

using Triple = std::array<std::size_t, 3>;

std::vector<Triple> triples_of(std::size_t count, std::uint64_t seed) {
  std::vector<Triple> result;
  // 19 pairs have 969 triples.
  if (count <= 19) {
    for (std::size_t a = 0; a < count; ++a)
      for (std::size_t b = a + 1; b < count; ++b)
        for (std::size_t c = b + 1; c < count; ++c) result.push_back({a, b, c});
    return result;
  }
  Rng rng(seed);
  const auto draw = [&] {
    return static_cast<std::size_t>(rng.uniform() * static_cast<double>(count));
  };
  while (result.size() < kMaxTriples) {
    const Triple triple{draw(), draw(), draw()};
    if (triple[0] != triple[1] && triple[0] != triple[2] && triple[1] != triple[2])
      result.push_back(triple);
  }
  return result;
}

class PositionsParser {
 public:
  explicit PositionsParser(const std::string& path) : path_(path) {}

  std::map<std::string, Eigen::Vector3d> parse(std::string_view text) {
    // byte order mark, as spreadsheets write it
    if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
    bool is_first = true;
    while (!text.empty()) {
      ++line_;
      const std::string_view line = trimmed(next_line(text));
      if (line.empty()) continue;
      parse_line(line, is_first);
      is_first = false;
    }
    if (positions_.empty())
      throw InputError(path_, "contains no position: expected lines name,x,y,z");
    return std::move(positions_);
  }

 private:
  [[noreturn]] void fail(const std::string& reason) const {
    throw InputError(path_, fmt::format("line {}: {}", line_, reason));
  }

  void parse_line(std::string_view rest, bool is_first) {
    std::string name = next_name(rest);
    std::array<std::optional<double>, 3> numbers;
    std::array<std::string_view, 3> words;
    for (std::size_t k = 0; k < 3; ++k) {
      if (rest.empty()) fail("expected name,x,y,z");
      rest.remove_prefix(1);  // the comma
      const std::size_t end = std::min(rest.find(','), rest.size());
      words[k] = trimmed(rest.substr(0, end));
      numbers[k] = to_number(words[k]);
      rest.remove_prefix(end);
    }
    if (!rest.empty()) fail("more than the four fields name,x,y,z");
    if (is_first && !numbers[0] && !numbers[1] && !numbers[2]) return;  // header line
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    for (std::size_t k = 0; k < 3; ++k) {
      if (!numbers[k] || std::abs(*numbers[k]) > kMaxCoordinate)
        fail(fmt::format("'{}' is not a coordinate", printable(words[k].substr(0, 80))));
      position[static_cast<int>(k)] = *numbers[k];
    }
    if (name.empty()) fail("the name is empty");
    if (!positions_.emplace(name, position).second)
      fail(fmt::format("'{}' occurs twice", printable(std::string_view(name).substr(0, 200))));
  }

  // Removes the name, quoted or not, so that `rest` is empty or begins with a comma.
  std::string next_name(std::string_view& rest) const {
    std::string name;
    if (!rest.starts_with('"')) {
      const std::size_t end = std::min(rest.find(','), rest.size());
      name = trimmed(rest.substr(0, end));
      rest.remove_prefix(end);
      return name;
    }
    rest.remove_prefix(1);
    while (true) {
      const std::size_t end = rest.find('"');
      if (end == std::string_view::npos) fail("the closing \" is missing");
      name += rest.substr(0, end);
      rest.remove_prefix(end + 1);
      if (!rest.starts_with('"')) break;
      name += '"';  // "" stands for one quote
      rest.remove_prefix(1);
    }
    rest = trimmed(rest);
    if (!rest.empty() && rest.front() != ',') fail("expected a comma after the name");
    return name;
  }

  const std::string& path_;
  std::map<std::string, Eigen::Vector3d> positions_;
  std::int64_t line_ = 0;
};

}  // namespace

std::optional<geometry::Sim3> robust_similarity(const std::vector<Eigen::Vector3d>& from,
                                                const std::vector<Eigen::Vector3d>& to,
                                                double tolerance, std::uint64_t seed) {
  TARSIER_REQUIRE(tolerance >= 0 && std::isfinite(tolerance), "tolerance {}", tolerance);
  const auto all_from = geometry::columns_of(from);
  const auto all_to = geometry::columns_of(to);
  TARSIER_REQUIRE(from.size() == to.size(), "{} points, but {} corresponding points", from.size(),
                  to.size());
  TARSIER_REQUIRE(all_from.allFinite() && all_to.allFinite(), "a point is not finite");
  if (from.size() < 3) return std::nullopt;
  const auto cost_of = [&](const geometry::Sim3& similarity) {
    const std::vector<double> residuals = residuals_of(similarity, from, to);
    if (tolerance == 0) return score_of(residuals);
    double cost = 0;  // truncated, so that of two with equally many pairs the closer one wins
    for (const double r : residuals) cost += std::min(1.0, r * r / (tolerance * tolerance));
    return cost;
  };

  std::optional<geometry::Sim3> best;
  double min_cost = 0;
  for (const Triple& triple : triples_of(from.size(), seed)) {
    const auto similarity =
        geometry::similarity_between(all_from(Eigen::all, triple), all_to(Eigen::all, triple));
    if (!similarity) continue;
    const double cost = cost_of(*similarity);
    if (!best || cost < min_cost) {
      best = similarity;
      min_cost = cost;
    }
  }
  if (!best) return std::nullopt;

  // Where all pairs fit exactly, rounding errors must not make them outliers.
  const Eigen::Vector3d mean_to = all_to.rowwise().mean();
  const double extent =
      std::max(mean_to.norm(), (all_to.colwise() - mean_to).colwise().norm().maxCoeff());
  // The least median of few pairs is biased to small values (Rousseeuw and Leroy 1987, 5.1).
  const double spread = 3 * (1 + 5.0 / (static_cast<double>(from.size()) - 2));
  std::vector<std::size_t> agreed;
  for (int k = 0; k < kMaxRefits; ++k) {
    const std::vector<double> residuals = residuals_of(*best, from, to);
    const double limit =
        tolerance > 0 ? tolerance : std::max(spread * score_of(residuals), 1e-12 * extent);
    std::vector<std::size_t> now;
    for (std::size_t i = 0; i < from.size(); ++i)
      if (residuals[i] <= limit) now.push_back(i);
    if (k == 0 && now.size() < 3) return std::nullopt;
    if (now == agreed) break;
    const auto refit =
        geometry::similarity_between(all_from(Eigen::all, now), all_to(Eigen::all, now));
    if (!refit) break;
    best = refit;
    agreed = now;
  }
  return best;
}

std::vector<double> residuals_of(const geometry::Sim3& similarity,
                                 const std::vector<Eigen::Vector3d>& from,
                                 const std::vector<Eigen::Vector3d>& to) {
  TARSIER_REQUIRE(from.size() == to.size(), "{} points, but {} corresponding points", from.size(),
                  to.size());
  std::vector<double> result(from.size());
  for (std::size_t k = 0; k < from.size(); ++k) result[k] = (similarity * from[k] - to[k]).norm();
  return result;
}

void transform(Model& model, const geometry::Sim3& similarity) {
  similarity.check();
  for (Point& point : model.points) point.position = similarity * point.position;
  for (Image& image : model.images)
    if (image.registered) image.pose = geometry::moved_camera(image.pose, similarity);
}

bool is_beyond_float(const Eigen::Vector3d& position, double length) {
  constexpr double kMaxShare = 1e-4;
  constexpr double kRounding = std::numeric_limits<float>::epsilon() / 2;  // of a number near 1
  return position.cwiseAbs().maxCoeff() * kRounding > kMaxShare * length;
}

std::map<std::string, Eigen::Vector3d> read_positions_csv(const std::string& path) {
  const std::string text = read_file(path, kMaxFileBytes);
  return PositionsParser(path).parse(text);
}

}  // namespace tarsier::sfm
