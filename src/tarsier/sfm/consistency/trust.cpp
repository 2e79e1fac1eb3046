// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/trust.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/image_cells.h"
#include "tarsier/sfm/consistency/pair_agreement.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace tarsier::sfm {
namespace {

constexpr double kFullTrustPoints = 50;
constexpr double kFullTrustCells = 12;
constexpr double kFullTrustShare = 0.5;

}  // namespace

std::vector<double> trust_of(const Model& model, const std::vector<Pair>& pairs,
                             const std::vector<std::uint8_t>& refused) {
  std::vector<double> agreeing(model.images.size(), 0);
  std::vector<double> all(model.images.size(), 0);
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const Pair& pair = pairs[k];
    if (pair.view.inliers.empty() || !model.images[at(pair.first)].registered ||
        !model.images[at(pair.second)].registered) {
      continue;
    }
    const bool is_agreeing = agrees(model, pair);
    if (refused[k] != 0 && !is_agreeing) continue;
    const auto inliers = static_cast<double>(pair.view.inliers.size());
    for (const int image : {pair.first, pair.second}) {
      all[at(image)] += inliers;
      if (is_agreeing && refused[k] == 0) agreeing[at(image)] += inliers;
    }
  }
  std::vector<double> trust(model.images.size(), 0);
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const Image& image = model.images[i];
    if (!image.registered || !(all[i] > 0)) continue;
    std::set<int> cells;
    double points = 0;
    double multi_view_points = 0;
    for (std::size_t f = 0; f < image.points.size(); ++f) {
      if (image.points[f] < 0) continue;
      points += 1;
      multi_view_points += model.points[at(image.points[f])].track.size() >= 3 ? 1 : 0;
      cells.insert(image_cell(image.features[f], model.cameras[at(image.camera)]));
    }
    if (!(points > 0)) continue;
    trust[i] = agreeing[i] / all[i] * std::min(1.0, points / kFullTrustPoints) *
               std::min(1.0, static_cast<double>(cells.size()) / kFullTrustCells) *
               std::min(1.0, multi_view_points / points / kFullTrustShare);
  }
  return trust;
}

double model_trust(const Model& model, const std::vector<double>& trust) {
  double sum = 0;
  double count = 0;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    if (!model.images[i].registered) continue;
    sum += trust[i];
    count += 1;
  }
  return count > 0 ? sum / count : 0;
}

}  // namespace tarsier::sfm
