// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <map>
#include <utility>
#include <vector>

namespace tarsier::sfm {

// Finds places that look alike and that a model superimposes: sides of a symmetrical object, two
// houses of the same type. They are found by features that are missing where the poses of the model
// predict them (after Heinly, Dunn and Frahm, Correcting for duplicate scene structure in sparse 3D
// reconstruction, ECCV 2014).
//
// Two images are near where their rays to a point of one of them differ by less than 12 degrees, at
// distances within a factor of 1.3. The other image should then show the point. It does where it
// has any feature within 2.5 px of the projection (in an image of 1000 px). The rate of chance hits
// is measured at positions beside it and subtracted.
//
// A point is rare where few of these images show it: less than 0.7 of the rate of most points. Such
// a point distinguishes places, or its detection is unreliable. Unreliable points are missing here
// and there. Of two superimposed places, the points of one are missing in all images of the other,
// and vice versa.
//
// Images with a larger distance share fewer unreliable points. So a pair is compared with the 90th
// percentile of the shares of pairs at least as far apart. It is evaluated only where that
// percentile is 0.35 or more of what is expected.
//
// A point that should appear in few images is rare also because the other image does not show it.
// So the rarity is computed once more without the other image. The two do not contradict each other
// where four or more such points are expected and 0.4 or more of them are observed.
class ModelConflicts {
 public:
  // How many of the distinctive points two near images, or the images around them, should share and
  // do.
  struct Evidence {
    double expected = 0;
    double found = 0;  // after subtraction of chance
  };

  // Uses one thread and no random numbers.
  explicit ModelConflicts(const Model& model);

  // Near images that contradict each other: of 8 or more expected points, the shared part is less
  // than 0.15, and less than a quarter of what is usual at their distance. Sorted by first, then
  // second; first < second.
  [[nodiscard]] const std::vector<std::pair<int, int>>& pairs() const { return pairs_; }
  // Whether these are more than chance explains: three or more, and one in 200 of the near images
  // with as much evidence. With `is_repetitive` (the scene is known to repeat) this suffices.
  // Otherwise two more conditions must hold.
  //
  // First, three or more contradict the same image, a fifth of those with as much evidence, and one
  // of these has nearly its view. Views are nearly the same if the angle between the rays / 12
  // degrees plus abs(log(ratio of the distances)) / log(1.3) is less than 1. In large sets, some
  // pairs lack shared points by chance, and more so images of a slanted surface from afar. An image
  // in a wrong place contradicts most images around it, including the nearest.
  //
  // Second, one image (two where 200 or more are compared) is contradicted by three or more that
  // show different places as a whole (are_different()). Or one in ten of those with as much
  // evidence contradict each other. In thousands of images as close as those of a video, each point
  // is detected in few, so what two images share varies widely. What all images of two places share
  // does not vary.
  [[nodiscard]] bool any(bool is_repetitive = false) const;
  // The summed evidence of two images and of the images that show the same place as either.
  [[nodiscard]] Evidence between(int first, int second) const;
  // Whether the two images, or all images of their places, show different places by between(). That
  // needs 20 or more expected points, of which few are found compared with near images of one
  // place.
  [[nodiscard]] bool are_different(int first, int second) const;
  // For each image, 0 to 1: the share of near images with as much evidence that contradict it.
  [[nodiscard]] const std::vector<double>& shares() const { return shares_; }

 private:
  struct Neighbour {
    int image;
    Evidence evidence;
    double distance;  // between the images: Comparison::distance()
  };
  [[nodiscard]] const Evidence* find(int first, int second) const;
  [[nodiscard]] std::vector<int> same_place(int image) const;
  void find_places();
  [[nodiscard]] bool shows_different_places(const Evidence& evidence) const;
  std::vector<std::vector<Neighbour>> neighbours_;  // for each image, sorted by image
  std::vector<std::pair<int, int>> pairs_;
  std::size_t evaluated_ = 0;          // pairs of near images with as much evidence
  bool is_clustered_ = false;          // some image is contradicted by several
  bool has_different_places_ = false;  // also if all images of their places are compared
  std::vector<double> shares_;
  std::vector<int> place_;  // for each image: one of the images of its place
  std::map<std::pair<int, int>, Evidence> between_places_;  // smaller index first
  double typical_share_ = 1;  // share of the expected points that images of one place have
};

// The pairs that made a model superimpose different places. They connect such places, and at least
// a fifth of their matches are points of the model. That excludes correct pairs between two such
// places, as the model has their images elsewhere. Where there is no such pair, returns all pairs
// that connect different places.
[[nodiscard]] std::vector<const Pair*> conflicting_pairs(const Model& model,
                                                         const ModelConflicts& conflicts,
                                                         const std::vector<const Pair*>& pairs);

}  // namespace tarsier::sfm
