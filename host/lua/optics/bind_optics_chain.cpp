// Bindings of viewing_chain: eye, lens, microscope and robot with what is uncertain of them,
// calibrated by all measurements together.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "host/lua/optics/chain_calls.h"
#include "host/lua/optics/classes.h"
#include "host/lua/optics/localizer_calls.h"

#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {
namespace {

using chain_calls::Chain;

// Chains are values: no call changes one, a calibration returns another.
Chain& chain_of(const Call& call) { return call.self<Chain>(); }

/// The chain is placed and differentiated here; a calibration makes another one.
int make_chain(Call& call) {
  optics::NominalChain nominal;
  nominal.prescription = eye_of(call);
  nominal.microscope = microscope_option(call).value_or(optics::Microscope{});
  nominal.image.pixel = call.number_option("pixel").value_or(nominal.image.pixel);
  if (call.push_option("center")) {
    const auto center = *to_numbers(call.L, -1);
    if (center.size() != 2) throw std::invalid_argument("center: wants two numbers {u, v}");
    nominal.image.center_px = {center[0], center[1]};
  }
  lua_pop(call.L, 1);
  const optics::ObjectModel body = localizer_calls::body_option(call);
  if (!(body.ellipsoid() && body.round_about_z()))
    throw std::invalid_argument("shape: wants a spheroid");
  nominal.robot = {body.semi_axes.z(), body.semi_axes.x()};
  nominal.plate_ratio = call.number_option("plate_ratio").value_or(nominal.plate_ratio);
  const optics::ChainSigmas sigmas = chain_calls::sigmas_option(call);
  push_handle(
      call.L, viewing_chain_class(),
      std::make_shared<Chain>(Chain{nominal, sigmas, optics::prior_belief(nominal, sigmas)}));
  return 1;
}

// In the parameter's own unit, though theta counts in sigmas: a person compares them with what was
// measured. `learned` is 1 - posterior / prior variance.
int parameters(Call& call) {
  const optics::ChainBelief& belief = chain_of(call).belief;
  const auto& all = belief.chain.parameters();
  return push_result_list(call, all.size(), [&](ResultTable& entry, std::size_t k) {
    const auto i = static_cast<Eigen::Index>(k);
    const double variance = belief.covariance(i, i);
    entry.text("parameter", all[k].name)
        .text("unit", all[k].unit)
        .number("off", all[k].sigma * belief.chain.theta()[i])
        .number("sigma", all[k].sigma * std::sqrt(variance))
        .number("prior_sigma", all[k].sigma)
        .number("learned", 1 - variance);
  });
}

// Rows and columns in the order of parameters(), for a file that a rig's model.chain can name.
int covariance(Call& call) {
  const optics::ChainBelief& belief = chain_of(call).belief;
  const auto& all = belief.chain.parameters();
  std::vector<double> values;
  for (Eigen::Index i = 0; i < belief.chain.size(); ++i)
    for (Eigen::Index j = 0; j < belief.chain.size(); ++j)
      values.push_back(belief.covariance(i, j) * all[static_cast<std::size_t>(i)].sigma *
                       all[static_cast<std::size_t>(j)].sigma);
  push_numbers(call.L, values);
  return 1;
}

// By the most probable parameters, nominal or calibrated; the forward way of locate.
int shown(Call& call) {
  const Chain& chain = chain_of(call);
  const OptionTable how(call, 0);
  const Eigen::Vector3d axis = how.vector("axis")->normalized();
  const auto seen = optics::shown_ellipse(
      chain.belief.chain, {*how.vector("position"), axis, chain.nominal.image.center_px});
  if (!seen) return 0;
  const optics::EllipseVector ellipse = optics::ellipse_from(*seen);
  ResultTable(call)
      .number("u", ellipse[0])
      .number("v", ellipse[1])
      .number("semi_major", ellipse[2])
      .number("semi_minor", ellipse[3])
      .number("angle", ellipse[4], "rad");
  return 1;
}

// One frame takes a tenth of a millisecond to judge and a few to find: no worker is needed. The
// axis' usual doubt is two degrees, how a field holds a soft robot.
int locate_in(Call& call) {
  const Chain& chain = chain_of(call);
  const OptionTable how(call, 0);
  const localizer_calls::SeenEllipse ellipse = localizer_calls::ellipse_option(call);
  const optics::OutlineSeen seen{ellipse.ellipse, ellipse.covariance,
                                 how.number("contour_sigma").value_or(0),
                                 how.number("axis_sigma").value_or(0.035)};
  const Eigen::Vector3d axis = how.vector("axis")->normalized();
  const auto position = optics::locate_in_chain(chain.belief.chain, seen, axis);
  if (!position) return 0;
  const Eigen::Vector3d touched = how.vector("touched").value_or(Eigen::Vector3d(0, 0, 0));
  const auto doubt = optics::position_doubt(chain.belief, {*position, axis, seen.ellipse.head<2>()},
                                            seen, optics::PositionFit::weighted, touched.head<2>());
  if (!doubt) return 0;
  // The surface as it is believed now: the nominal one, and what calibration has moved it by there.
  const double retina = optics::nominal_retina(chain.belief.chain, touched.head<2>()) +
                        optics::retina_offset(chain.belief.chain, touched.head<2>());
  return chain_calls::push_position(call, *position, position->z() - retina, *doubt);
}

// Of a session: fit, outliers and minima, into the table on top of the stack.
void add_fit(Call& done, ResultTable& table, const optics::ChainEstimate& made) {
  table.number("chi2", made.chi2)
      .integer("degrees_of_freedom", made.degrees_of_freedom)
      .number("chi2_limit", made.chi2_limit)
      .text("status", to_string(made.status))
      .list("outliers", made.outliers.size(),
            [&](ResultTable& entry, std::size_t i) {
              entry.integer("look", static_cast<lua_Integer>(made.outliers[i].look) + 1)
                  .number("chi2", made.outliers[i].chi2);
            })
      .list("minima", made.minima.size(), [&](ResultTable& entry, std::size_t i) {
        const auto& theta = made.minima[i].theta;
        entry.number("chi2", made.minima[i].chi2).numbers("theta", {theta.begin(), theta.end()});
      });
  // Parameters of which less than a tenth of the variance was learned: they stand as believed
  // before.
  lua_newtable(done.L);
  lua_Integer count = 0;
  for (const std::string& name : optics::unobserved(made.belief)) {
    lua_pushstring(done.L, name.c_str());
    lua_rawseti(done.L, -2, ++count);
  }
  table.top("unobserved");
}

// Seconds for a long session, so it runs as a calculation that a stop ends. Copies of chain and
// session go with it, since the script's handles may be gone before it ends. A calibration always
// begins from what was known before any: measurements of two sessions are given together.
int calibrate_chain(Call& call) {
  const Chain before = chain_of(call);
  const optics::ChainSession session = chain_calls::session_options(call);
  optics::ChainEstimatorSettings settings;
  settings.starts = static_cast<int>(call.number_option("starts").value_or(settings.starts));
  // A dry run's looks are no measurements, in which the minimum would be searched for minutes.
  const bool rehearsed = session_of(call.L).rehearsal != nullptr;
  return calculate(
      call, "calibrate chain",
      [before, session, settings, rehearsed](const YieldPoint&) {
        if (rehearsed) return optics::ChainEstimate{.belief = before.belief};
        return optics::estimate_chain(before.nominal, before.sigmas, session, settings);
      },
      [before, session, rehearsed](Call& done, const optics::ChainEstimate& made) {
        ResultTable table(done);
        optics::ChainAnchors anchors;
        if (!rehearsed) anchors = {session.looks, made.places};
        push_handle(done.L, viewing_chain_class(),
                    std::make_shared<Chain>(
                        Chain{before.nominal, before.sigmas, made.belief, {}, anchors}));
        table.top("chain");
        add_fit(done, table, made);
        return 1;
      });
}

// What is left now is stated beside the plan: a plan that gains nothing says so.
int next_measurement(Call& call) {
  const Chain& chain = chain_of(call);
  const std::string goal = call.text_option("goal").value_or("height");
  const auto steps = static_cast<int>(call.number_option("steps").value_or(5));
  const optics::PlanGoal wanted = goal == "depth"   ? optics::PlanGoal::depth
                                  : goal == "aside" ? optics::PlanGoal::aside
                                                    : optics::PlanGoal::height;
  const auto taken =
      optics::plan(chain.belief, optics::usual_candidates(chain.belief), wanted, steps);
  ResultTable table(call);
  table.number("leaves_now", optics::left_of(chain.belief, wanted), "m")
      .list("steps", taken.size(), [&](ResultTable& entry, std::size_t i) {
        entry.text("measurement", taken[i].name).number("leaves", taken[i].leaves, "m");
      });
  return 1;
}

// As localizer:ellipse and the servo's record have it: semi-axes in pixels.
Argument of_ellipse() {
  const auto number = [](const char* name, const char* unit, bool optional, const char* help,
                         double min) {
    return Argument{.name = name,
                    .type = Type::number,
                    .unit = unit,
                    .optional = optional,
                    .min = min,
                    .max = 1e6,
                    .help = help};
  };
  return {.name = "ellipse",
          .type = Type::options,
          .help = "that a tracker saw",
          .options = {number("u", "", false, "center, px", -1e6),
                      number("v", "", false, "center, px", -1e6),
                      number("semi_major", "", false, "px", 1e-6),
                      number("semi_minor", "", false, "px", 1e-6),
                      number("angle", "rad", false, "from +u towards +v", -1e6),
                      number("sigma", "", true, "of center and axes, px (0.2)", 1e-6),
                      {.name = "covariance",
                       .type = Type::numbers,
                       .optional = true,
                       .help = "25 numbers, row by row, instead of sigma"}}};
}

// Fewer starts than five are for comparison: a twin solution may be taken for the only one.
std::vector<Argument> calibrate_options() {
  std::vector<Argument> options = chain_calls::session_arguments();
  options.push_back(number_option("starts", "", 1, 5, "from turned eyes (5)"));
  return options;
}

// `touched` says where the height counts from; the middle of the retina unless a script says
// otherwise.
Binding locate_in_row() {
  return {"locate",
          {options_of({of_ellipse(),
                       {.name = "axis", .type = Type::direction, .help = "the body's z"},
                       number_option("axis_sigma", "rad", 1e-6, 1, "across it (0.035)"),
                       number_option("contour_sigma", "", 0, 10,
                                     "px, of each semi-axis: the outline is not quite the "
                                     "ellipsoid's (0)"),
                       {.name = "touched",
                        .type = Type::vector,
                        .unit = "m",
                        .optional = true,
                        .help = "where it lay on the retina ({0, 0, 0})"}})},
          Returned("table", chain_calls::position_fields()).or_nil("outside"),
          "position with the uncertainty of outline, axis, eye, lens, microscope and robot",
          locate_in,
          "chain:locate { ellipse = seen, axis = { 1, 0, 0 } }"};
}

}  // namespace

// The body is the chain's: its size is one of the parameters.
std::vector<Binding> system_chain_rows() {
  return {{"viewing_chain",
           {options_of({microscope_argument(),
                        localizer_calls::body_argument(),
                        number_option("plate_ratio", "", 1e-3, 1,
                                      "thickness over width of two crossed plates, one of them "
                                      "level, that fill it (1: it is round)"),
                        length_option("pixel", 1e-9, 1e-3, "of aerial image (14.3 µm)"),
                        {.name = "center",
                         .type = Type::numbers,
                         .optional = true,
                         .help = "{u, v} of the image's axis, px ({0, 0})"},
                        chain_calls::uncertainty_argument()})},
           "viewing_chain",
           "the whole chain with what is uncertain of it, to be calibrated",
           make_chain,
           "eye:viewing_chain { body = robot }"}};
}

const Class& viewing_chain_class() {
  static const Class kind{
      "viewing_chain",
      "eye, condensing lens, microscope and robot with their uncertainty; make one with "
      "optical_system:viewing_chain",
      {{"parameters",
        {},
        {"list of tables", chain_calls::parameter_fields()},
        "what may be off, and what is known of it",
        parameters,
        "chain:parameters()"},
       {"covariance",
        {},
        "list of numbers",
        "of the parameters, row by row, each in its own unit",
        covariance,
        "chain:covariance()"},
       {"ellipse",
        {options_of({{.name = "position", .type = Type::vector, .unit = "m", .help = "eye frame"},
                     {.name = "axis", .type = Type::direction, .help = "the body's z"}})},
        Returned("table", std::vector<ResultField>{{"u", "", "center, px"},
                                                   {"v", "", "center, px"},
                                                   {"semi_major", "", "px"},
                                                   {"semi_minor", "", "px"},
                                                   {"angle", "rad", "from +u towards +v"}})
            .or_nil("outside"),
        "what a tracker would see of the robot, by what is believed",
        shown,
        "chain:ellipse { position = { 0, 0, 2 * mm }, axis = { 1, 0, 0 } }"},
       locate_in_row(),
       {"calibrate",
        {options_of(calibrate_options())},
        {"table",
         {{"chain", "", "the calibrated viewing_chain"},
          {"chi2", "", "of measurements and of what was known before"},
          {"degrees_of_freedom", "", ""},
          {"chi2_limit", "", "a right session is above it in one case of 200"},
          {"status", "",
           "\"found\", \"ambiguous\" (several minima), \"misfit\" (no chain explains the session) "
           "or "
           "\"not_converged\"; the chain of the last two is no result"},
          {"outliers",
           "",
           "of a misfit, the looks without which the rest fits, the worst first",
           {{"look", "", "its number"}, {"chi2", "", ""}}},
          {"minima",
           "",
           "every chain that explains the session, the best first",
           {{"chi2", "", ""}, {"theta", "", "its parameters, each in its sigma before"}}},
          {"unobserved", "", "names of parameters of which next to nothing was learned"}}},
        "the most probable chain by all measurements together, from several starts",
        calibrate_chain,
        "chain:calibrate { looks = { look } }"},
       chain_calls::refine_row(),
       {"next",
        {options_of({{.name = "goal",
                      .type = Type::text,
                      .optional = true,
                      .help = "what is to become small (height)",
                      .choices = {"height", "depth", "aside"}},
                     number_option("steps", "", 1, 20, "(5)")})},
        {"table",
         {{"leaves_now", "m", "calibration's part, median over the workspace"},
          {"steps",
           "",
           "the best measurement first, each beside those before it",
           {{"measurement", "", ""}, {"leaves", "m", ""}}}}},
        "which measurement would take most of what is not known",
        next_measurement,
        "chain:next { goal = \"depth\" }"}},
      {}};
  return kind;
}

}  // namespace vitreo::lua
