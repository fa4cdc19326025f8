// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/tail_motion.h"

#include "control/robots.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

constexpr double kEta = 0.485;  // Pa s
constexpr double kField = 10e-3;
constexpr double kStep = 1e-3;  // s
constexpr double kTurn = 2 * std::numbers::pi;

control::FlexibleTail tail_of(double modulus) {
  control::FlexibleTail tail;
  tail.modulus = modulus;
  return tail;
}
double moment() { return control::robot_named("tail_3mm").moment(0); }

/// The reference: a plane chain of stiff rods with springs between them, each of which resists by
/// its local drag, at any angle (the coarse-grained elastica of Moreau, Giraldi & Gadelha 2018, J.
/// R. Soc. Interface 15, 20180235). Neither modes nor small slopes are in it. Unknowns: the head's
/// place and the angles of head and rods.
class Chain {
 public:
  static constexpr int kRods = 10;
  static constexpr int kUnknowns = 3 + kRods;
  using Vector = Eigen::Matrix<double, kUnknowns, 1>;
  using Matrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  Chain(const control::FlexibleTail& tail, double moment) : tail_(tail), moment_(moment) {}

  /// The midpoint rule: by the drag in the middle of the step, which is where half a step leads.
  void step(const Eigen::Vector2d& field, double span) {
    const Vector middle = state_ + span / 2 * rates(state_, field, span / 2);
    state_ += span * rates(middle, field, span / 2);
  }
  double along_x() const { return state_[0]; }

 private:
  /// By the drag at `at`, springs and field being taken `ahead` s later than state_.
  Vector rates(const Vector& at, const Eigen::Vector2d& field, double ahead) const {
    const double rod = tail_.length / kRods;
    const auto drag = control::tail_drag(tail_, kEta);
    const auto along = [&](int i) {
      return Eigen::Vector2d(std::cos(at[2 + i]), std::sin(at[2 + i]));
    };
    const Eigen::Vector2d head(std::cos(state_[2]), std::sin(state_[2]));
    Matrix R = Matrix::Zero();
    R(0, 0) = R(1, 1) = drag.head;
    R(2, 2) = drag.head_spin;
    Eigen::Matrix<double, 2, kUnknowns> J = Eigen::Matrix<double, 2, kUnknowns>::Zero();
    J.leftCols<2>().setIdentity();
    const auto turned = [&](int i, double lever) -> Eigen::Vector2d {
      return -lever * Eigen::Vector2d(-along(i).y(), along(i).x());
    };
    J.col(2) = turned(0, tail_.head_radius);
    for (int i = 1; i <= kRods; ++i) {
      const Eigen::Matrix2d local =
          drag.normal * Eigen::Matrix2d::Identity() +
          (drag.tangential - drag.normal) * along(i) * along(i).transpose();
      for (const double root : {-1 / std::sqrt(3.0), 1 / std::sqrt(3.0)}) {  // Gauss' two points
        J.col(2 + i) = turned(i, rod * (1 + root) / 2);
        R += rod / 2 * J.transpose() * local * J;
      }
      J.col(2 + i) = turned(i, rod);
    }
    Vector load = Vector::Zero();
    Matrix stiff = Matrix::Zero();
    load[2] = moment_ * (head.x() * field.y() - head.y() * field.x());
    stiff(2, 2) = moment_ * std::max(0.0, head.dot(field));
    for (int i = 0; i < kRods; ++i) {
      // Between the head and the middle of the first rod there is half a rod alone.
      const double spring = tail_.stiffness() / rod * (i == 0 ? 2 : 1);
      const double bent = state_[3 + i] - state_[2 + i];
      load[2 + i] += spring * bent;
      load[3 + i] -= spring * bent;
      stiff(2 + i, 2 + i) += spring;
      stiff(3 + i, 3 + i) += spring;
      stiff(2 + i, 3 + i) -= spring;
      stiff(3 + i, 2 + i) -= spring;
    }
    return Matrix(R + ahead * stiff).llt().solve(load);
  }

  control::FlexibleTail tail_;
  double moment_;
  Vector state_ = Vector::Zero();
};

/// T, at a time: the largest magnitude is kField.
Eigen::Vector3d swinging(double swing, double frequency, double time) {
  return kField *
         Eigen::Vector3d(std::cos(swing), std::sin(swing) * std::sin(kTurn * frequency * time), 0);
}

/// m/s, mean over the last whole beats; `each` gets the time of each step and its length.
template <typename Place, typename Each>
double speed_of(double frequency, double span, Place place, Each each) {
  const int before = static_cast<int>(std::ceil(3 / frequency / span));
  const int measured = static_cast<int>(std::lround(4 / frequency / span));
  double from = 0;
  for (int k = 0; k < before + measured; ++k) {
    if (k == before) from = place();
    each((k + 0.5) * span, span);
  }
  return (place() - from) / (measured * span);
}

double swum(const control::FlexibleTail& tail, double swing, double frequency,
            double* widest = nullptr) {
  TailMotion motion(tail, kEta, moment());
  BodyState body{{0, 0, 0}, {1, 0, 0}, tail.reach(), tail.head_radius};
  return speed_of(
      frequency, kStep, [&] { return body.position.x(); },
      [&](double time, double span) {
        body.position +=
            motion.turn(body, swinging(swing, frequency, time), Eigen::Vector3d::Zero(), span).swum;
        if (widest != nullptr) *widest = std::max(*widest, motion.deflection(1).norm());
      });
}

double swum_by_chain(const control::FlexibleTail& tail, double swing, double frequency) {
  Chain chain(tail, moment());
  return speed_of(
      frequency, 0.5e-3, [&] { return chain.along_x(); },
      [&](double time, double span) {
        chain.step(swinging(swing, frequency, time).head<2>(), span);
      });
}

TEST(TailMotion, SwimsAsAChainOfManyRodsDoes) {
  for (const double modulus : {0.15e9, 0.3e9, 1e9})
    for (const double frequency : {1.0, 3.0, 8.0}) {
      const double small = swum(tail_of(modulus), 0.15, frequency);
      EXPECT_NEAR(small / swum_by_chain(tail_of(modulus), 0.15, frequency), 1, 0.06)
          << modulus << " Pa, " << frequency << " Hz: four modes, ten rods";
      EXPECT_GT(small, 0) << "head first";
    }
}

// At the swing in use the tail's slopes are no longer small.
TEST(TailMotion, AtAWideSwingTheSlopesThatAreTakenForSmallCostLittle) {
  for (const double frequency : {1.0, 3.0, 8.0}) {
    const double wide = swum(tail_of(0.3e9), 0.7, frequency);
    EXPECT_NEAR(wide / swum_by_chain(tail_of(0.3e9), 0.7, frequency), 1, 0.25) << frequency;
  }
}

// What is stiff moves there and back alike (Purcell 1977).
TEST(TailMotion, AStiffTailGoesNowhere) {
  const double soft = swum(tail_of(0.3e9), 0.5, 3);
  EXPECT_LT(std::abs(swum(tail_of(0.3e12), 0.5, 3)), 0.01 * soft);
  EXPECT_GT(soft, 50e-6);
}

TEST(TailMotion, ThrustGoesWithTheSquareOfASmallSwing) {
  EXPECT_NEAR(swum(tail_of(0.3e9), 0.1, 3) / swum(tail_of(0.3e9), 0.05, 3), 4, 0.1);
}

// Faster is better until the wave no longer reaches the tail's end and the head no longer turns.
TEST(TailMotion, TheSpeedHasItsBestFrequency) {
  const double slow = swum(tail_of(0.15e9), 0.7, 0.5), best = swum(tail_of(0.15e9), 0.7, 6),
               fast = swum(tail_of(0.15e9), 0.7, 40);
  EXPECT_GT(best, 2 * slow);
  EXPECT_GT(best, 1.1 * fast);
}

// A force on the head of a body that no field holds: it moves as a straight one does, and turns.
TEST(TailMotion, AForceAlongTheAxisBendsNothing) {
  const control::FlexibleTail tail;
  TailMotion motion(tail, kEta, moment());
  BodyState body{{0, 0, 0}, {1, 0, 0}, 1e-3, 0.3e-3};
  const auto step = motion.turn(body, {0, 0, 0}, {1e-7, 0, 0}, 0.1);
  EXPECT_LT(step.swum.norm(), 1e-15) << "the force's own way is the caller's";
  EXPECT_LT(motion.deflection(1).norm(), 1e-15);
  const auto turned = motion.turn(body, {0, 0, 0}, {0, 0, -1e-7}, 0.1);
  EXPECT_GT(turned.turned.y(), 1e-4) << "the head, at +x, goes down";
}

TEST(TailMotion, ABodyTurnsIntoTheFieldFromAnywhere) {
  const control::FlexibleTail tail;
  TailMotion motion(tail, kEta, moment());
  BodyState body{{0, 0, 0}, Eigen::Vector3d(-1, 0.01, 0.2).normalized(), 1e-3, 0.3e-3};
  for (int k = 0; k < 3000; ++k) motion.turn(body, {0, 0, kField}, {0, 0, 0}, kStep);
  EXPECT_LT((body.axis - Eigen::Vector3d::UnitZ()).norm(), 1e-3);
  EXPECT_LT(motion.deflection(1).norm(), 1e-6) << "and its tail is straight again";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
