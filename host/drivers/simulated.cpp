// The simulated laboratory's own stages and field probe as a rig file describes them: direct, without a wire.
// SPDX-License-Identifier: Apache-2.0
#include "host/drivers/drivers.h"

namespace vitreo {
namespace {

/// The laboratory keeps its stages; this is what a role is given.
class BorrowedStage : public Stage {
 public:
  explicit BorrowedStage(Stage& stage) : stage_(stage) {}
  const StageInfo& info() const override { return stage_.info(); }
  std::vector<double> position() override { return stage_.position(); }
  void start(std::span<const double> target, double speed) override { stage_.start(target, speed); }
  bool moving() override { return stage_.moving(); }
  void wait(Time timeout) override { stage_.wait(timeout); }
  void home(Time timeout) override { stage_.home(timeout); }
  void stop() override { stage_.stop(); }
  void make_safe() override { stage_.make_safe(); }

 private:
  Stage& stage_;
};

class BorrowedRotation : public RotationStage {
 public:
  explicit BorrowedRotation(RotationStage& stage) : stage_(stage) {}
  const RotationStageInfo& info() const override { return stage_.info(); }
  double angle() override { return stage_.angle(); }
  void start(double angle, double speed) override { stage_.start(angle, speed); }
  bool moving() override { return stage_.moving(); }
  void wait(Time timeout) override { stage_.wait(timeout); }
  void home(Time timeout) override { stage_.home(timeout); }
  void stop() override { stage_.stop(); }
  void make_safe() override { stage_.make_safe(); }

 private:
  RotationStage& stage_;
};

class BorrowedProbe : public FieldProbe {
 public:
  explicit BorrowedProbe(FieldProbe& probe) : probe_(probe) {}
  const FieldProbeInfo& info() const override { return probe_.info(); }
  FieldReading measure(Time timeout) override { return probe_.measure(timeout); }

 private:
  FieldProbe& probe_;
};

void only_emulated(const InstrumentReader& instrument) {
  if (!instrument.emulated()) instrument.reader.fail("address", "must be \"emulated\"");
}

void read_axis(ConfigReader& reader, StageAxis& axis) {
  axis.max_speed = reader.number("max_speed", axis.max_speed, {1e-6, 10, ""});
  axis.speed = std::min(axis.speed, axis.max_speed);
  axis.resolution = reader.number("resolution", axis.resolution, {0, 1e-2, ""});
}

}  // namespace

Opener<Stage> read_simulated_stage(const InstrumentReader& instrument) {
  only_emulated(instrument);
  ConfigReader& reader = instrument.reader;
  const bool probe = reader.choice("carries", "sensor", {"sensor", "probe"}) == "probe";
  StageAxis& axis = probe ? instrument.laboratory.probe_axis : instrument.laboratory.sensor_axis;
  axis.travel_max = reader.number("travel", axis.travel_max, {0, 0.1, "m"});
  axis.travel_min = -axis.travel_max;
  read_axis(reader, axis);
  return [probe](const Surroundings& where) -> Opened<Stage> {
    Stage& stage = probe ? where.laboratory->probe_stage() : where.laboratory->sensor_stage();
    return {nullptr, std::make_unique<BorrowedStage>(stage)};
  };
}

Opener<RotationStage> read_simulated_rotation(const InstrumentReader& instrument) {
  only_emulated(instrument);
  read_axis(instrument.reader, instrument.laboratory.sensor_turn);
  return [](const Surroundings& where) -> Opened<RotationStage> {
    return {nullptr, std::make_unique<BorrowedRotation>(where.laboratory->sensor_rotation())};
  };
}

Opener<FieldProbe> read_simulated_probe(const InstrumentReader& instrument) {
  only_emulated(instrument);
  ConfigReader& reader = instrument.reader;
  sim::ProbeSettings& probe = instrument.laboratory.probe;
  probe.noise = reader.number("noise", probe.noise, {0, 1e-2, "T"});
  probe.range = reader.number("range", probe.range, {1e-6, 10, "T"});
  probe.integration = reader.number("integration", probe.integration, {0, 10, "s"});
  return [](const Surroundings& where) -> Opened<FieldProbe> {
    return {nullptr, std::make_unique<BorrowedProbe>(where.laboratory->field_probe())};
  };
}

}  // namespace vitreo
