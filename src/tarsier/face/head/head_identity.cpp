// SPDX-License-Identifier: MIT
#include "tarsier/face/head/head_identity.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"

namespace tarsier::face::head {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd HeadIdentity::shape(const HeadModel& model) const {
  const Index m = model.mode_count();
  if (frames == 0) return VectorXd::Zero(m);
  TARSIER_REQUIRE(vector.size() == m, "an identity of {} modes for a model of {}", vector.size(),
                  m);
  const MatrixXd with_prior = information + MatrixXd::Identity(m, m);
  return linalg::Cholesky(with_prior).solve(vector).cwiseProduct(model.deviation);
}

void add_frame(const MatrixXd& normal, const VectorXd& right, const VectorXd& c,
               const HeadPoseOptions& options, HeadIdentity& identity) {
  const Index m = c.size();
  const linalg::Cholesky pose_part(normal.topLeftCorner(6, 6));
  const MatrixXd coupling = pose_part.solve(normal.topRightCorner(6, m));
  MatrixXd information = normal.bottomRightCorner(m, m) - normal.bottomLeftCorner(m, 6) * coupling;
  VectorXd vector = right.tail(m) - coupling.transpose() * right.head(6) + information * c;
  const MatrixXd softened = MatrixXd::Identity(m, m) + options.expression_share * information;
  information = linalg::solve_general(softened, information);
  vector = linalg::solve_general(softened, vector);
  information = (information + information.transpose()).eval() / 2;
  if (information.allFinite() && vector.allFinite()) {
    if (identity.frames == 0) {
      identity.information = MatrixXd::Zero(m, m);
      identity.vector = VectorXd::Zero(m);
    }
    identity.information = options.memory * identity.information + information;
    identity.vector = options.memory * identity.vector + vector;
    ++identity.frames;
  }
}

}  // namespace tarsier::face::head
