// Binding of viewing_chain:refine: self-calibration by frames of a run.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/chain_calls.h"
#include "host/lua/optics/classes.h"

#include <array>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

namespace vitreo::lua::chain_calls {
namespace {

/// In the order of RefinerOutcome.
constexpr std::size_t kOutcomes = 5;

struct Refined {
  std::shared_ptr<const optics::ChainRefiner> refiner;
  std::array<lua_Integer, kOutcomes> counts{};
};

/// s, between looks without times: no two of them share an outline.
constexpr double kFarApart = 1e3;

std::vector<double> times_of(const Call& call, std::size_t count) {
  std::vector<double> times = call.numbers_option("times").value_or(std::vector<double>{});
  if (times.empty())
    for (std::size_t i = 0; i < count; ++i) times.push_back(kFarApart * static_cast<double>(i));
  if (times.size() != count) throw std::invalid_argument("times: wants one for each look");
  return times;
}

/// The frame's place is found by the chain as it is refined until then. Of a look that lies on the
/// retina or was measured only the picture counts.
Refined refined_by(const Chain& before, const optics::ChainSession& session,
                   const std::vector<double>& times, int work, const YieldPoint& breath) {
  auto refiner = before.refiner
                     ? std::make_shared<optics::ChainRefiner>(*before.refiner)
                     : std::make_shared<optics::ChainRefiner>(
                           before.belief, optics::ChainRefinerSettings{}, before.anchors);
  Refined made;
  for (std::size_t i = 0; i < session.looks.size(); ++i) {
    const optics::ChainLook& look = session.looks[i];
    const auto near = optics::locate_in_chain(refiner->belief().chain, look.seen, look.axis);
    const auto outcome =
        near ? refiner->add(look.seen, look.axis, *near, times[i]) : optics::RefinerOutcome::misfit;
    ++made.counts[static_cast<std::size_t>(outcome)];
    refiner->work(work);
    breath();
  }
  made.refiner = std::move(refiner);
  return made;
}

int refine(Call& call) {
  const Chain before = call.self<Chain>();
  const optics::ChainSession session = session_options(call);
  const std::vector<double> times = times_of(call, session.looks.size());
  const auto work = static_cast<int>(call.number_option("work").value_or(20));
  // A dry run's looks are no measurements: they would be a changed bench.
  const bool rehearsed = session_of(call.L).rehearsal != nullptr;
  return calculate(
      call, "refine chain",
      [before, session, times, work, rehearsed](const YieldPoint& breath) {
        return refined_by(before, rehearsed ? optics::ChainSession{} : session, times, work,
                          breath);
      },
      [before](Call& done, const Refined& made) {
        const optics::ChainRefiner& refiner = *made.refiner;
        ResultTable table(done);
        push_handle(done.L, viewing_chain_class(),
                    std::make_shared<Chain>(
                        Chain{before.nominal, before.sigmas, refiner.belief(), made.refiner}));
        table.top("chain")
            .integer("frames", static_cast<lua_Integer>(refiner.frames()))
            .integer("explanations", static_cast<lua_Integer>(refiner.explanations()))
            .number("chi2", refiner.chi2())
            .number("change_evidence", refiner.change_evidence())
            .number("height_before", optics::left_of(before.belief, optics::PlanGoal::height), "m")
            .number("height", optics::left_of(refiner.belief(), optics::PlanGoal::height), "m")
            .number("depth", optics::left_of(refiner.belief(), optics::PlanGoal::depth), "m");
        if (refiner.changed()) table.text("changed", refiner.changed()->part);
        const char* const kNames[kOutcomes] = {"taken", "no_new", "misfit", "dropped", "full"};
        for (std::size_t i = 0; i < kOutcomes; ++i) table.integer(kNames[i], made.counts[i]);
        return 1;
      });
}

}  // namespace

Binding refine_row() {
  std::vector<Argument> options{session_arguments().front(),
                                {.name = "times",
                                 .type = Type::numbers,
                                 .unit = "s",
                                 .optional = true,
                                 .help = "of the looks (far apart)"},
                                number_option("work", "", 1, 10000,
                                              "frames that are looked at anew with each new one "
                                              "(20)")};
  return {"refine",
          {options_of(std::move(options))},
          {"table",
           {{"chain", "", "the refined viewing_chain; refine it again with the next frames"},
            {"frames", "", "in it, of all calls"},
            {"explanations", "", "chains that explain them equally: twins are in its uncertainty"},
            {"chi2", "", "of two degrees a frame"},
            {"change_evidence", "", "that the bench has changed: log of a ratio, alarm at 5.3"},
            {"height_before", "m", "left of the height above the retina to calibration, before"},
            {"height", "m", "the same, now"},
            {"depth", "m", "left of the absolute depth to calibration"},
            {.name = "changed",
             .help = "what moved: condensing_lens, eye_rotation, microscope, robot or bench; then "
                     "no frame is taken any more; nil while nothing did",
             .optional = true},
            {"taken", "", "frames of this call that count"},
            {"no_new", "", "too near to an earlier one in place and time"},
            {"misfit", "", "no place of the robot explains it"},
            {"dropped", "", "since the bench has changed"},
            {"full", "", "a thousand frames are in it"}}},
          "self-calibration: the chain refined by frames of a run, with guards against a "
          "bench that changes, and twins",
          refine,
          "chain:refine { looks = { look } }"};
}

}  // namespace vitreo::lua::chain_calls
