// SPDX-License-Identifier: Apache-2.0
#include "optics/system/zemax.h"

#include "optics/system/names.h"
#include "optics/system/zemax_text.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

using detail::ZemaxLine;

/// No lens has so many; a longer file is a mistake.
constexpr std::size_t kMostSurfaces = 1000;

/// Index at the d line of glasses that lenses for the eye are made of.
constexpr std::array<std::pair<std::string_view, double>, 18> kGlasses{{
    {"N-BK7", 1.51680},
    {"BK7", 1.51680},
    {"N-SF11", 1.78472},
    {"SF11", 1.78472},
    {"N-SF6", 1.80518},
    {"N-LASF9", 1.85025},
    {"N-LAK22", 1.65113},
    {"N-BAK4", 1.56883},
    {"N-SK16", 1.62041},
    {"N-F2", 1.62005},
    {"F2", 1.62004},
    {"SF5", 1.67270},
    {"B270", 1.52300},
    {"SILICA", 1.45846},
    {"PMMA", 1.49176},
    {"POLYCARB", 1.58547},
    {"WATER", 1.33304},
    {"CAF2", 1.43384},
}};

/// Operands without influence on the light through centered surfaces, or that repeat others.
constexpr std::string_view kHarmless[] = {
    "VERS", "PFIL", "LANG", "GCAT", "NOTE", "ENVD", "GFAC", "RAIM", "PUSH", "SDMA", "FTYP", "ROPD",
    "PICB", "XFLN", "YFLN", "FWGN", "VDXN", "VDYN", "VCXN", "VCYN", "VANN", "XFLD", "YFLD", "FWGT",
    "VDSX", "VDSY", "VCXS", "VCYS", "VANS", "ZVDX", "ZVDY", "ZVCX", "ZVCY", "ZVAN", "WWGT", "WWGN",
    "POLS", "GLRS", "GSTD", "NSCD", "COFN", "COAT", "TOL",  "TOLE", "MOFF", "BLNK", "HIDE", "MIRR",
    "SLAB", "POPS", "MEMA", "PKUP", "CONF", "EFFL", "OPDX", "FNUM", "OBNA", "FLOA", "SCOL", "DMFS",
    "OPTG", "HYPR", "CSLB", "FIMP", "ZEMX", "UDAT", "MCOP"};

/// UNIT names the lens unit; all lengths of the file are in it, wavelengths excepted.
/// An unknown unit is refused, as a guess would scale the whole lens.
double meters_per_unit(const ZemaxLine& line) {
  const std::string unit = line.words.empty() ? "" : line.words[0];
  if (unit == "MM") return 1e-3;
  if (unit == "CM") return 1e-2;
  if (unit == "IN") return 0.0254;
  if (unit == "M" || unit == "METER" || unit == "METERS") return 1;
  line.refuse("unit \"" + unit.substr(0, 20) + "\" is none of MM, CM, IN, M");
}

/// GLAS: a glass of the table above, or a model glass with the index in the line.
/// No dispersion: the index at the d line stands for all wavelengths.
double index_of(const ZemaxLine& line) {
  if (line.words.empty()) line.refuse("the glass has no name");
  const std::string& name = line.words[0];
  if (name == "MIRROR") line.refuse("mirrors are not supported");
  // Second word: 1 is a model glass, whose index stands in the line; others name a catalogue.
  const bool model = name == "___BLANK" || (line.words.size() > 1 && line.words[1] == "1");
  if (model) {
    const double index = line.number_at(3, "index");
    if (!(index >= 1 && index <= 5)) line.refuse("index must lie within 1 and 5");
    return index;
  }
  std::vector<std::string> known;
  for (const auto& [glass, index] : kGlasses) {
    if (glass == name) return index;
    known.emplace_back(glass);
  }
  line.refuse("glass \"" + name.substr(0, 40) + "\" is not known" +
              detail::suggestions(name, known) + " A model glass (index in the file) always works");
}

/// One pass over the lines. A SURF line begins a surface, indented lines belong to it, all others
/// to the header.
/// The reader keeps the lens' unit, the shape and the rim of the surface that it is in; all else
/// goes straight into the file's fields.
class Reader {
 public:
  ZemaxFile read(std::string_view bytes);

 private:
  void header(const ZemaxLine& line);
  bool header_wavelength(const ZemaxLine& line);
  void begin_surface(const ZemaxLine& line);
  void in_surface(const ZemaxLine& line);
  bool surface_shape(const ZemaxLine& line);
  bool surface_edge(const ZemaxLine& line);
  void parameter(const ZemaxLine& line);
  void break_parameter(int which, double value, const ZemaxLine& line);
  void biconic_parameter(int which, double value, const ZemaxLine& line);
  void finish();
  Surface& surface() { return file_.surfaces.back(); }
  int number() const { return static_cast<int>(file_.surfaces.size()) - 1; }

  ZemaxFile file_;
  double unit_ = 1e-3;  // Zemax' own default
  bool unit_used_ = false;
  enum class Type { standard, asphere, biconic, coordinate_break };
  Type type_ = Type::standard;
  double diameter_ = 0;  // DIAM of the current surface, a semi-diameter, m
  int primary_ = 1;      // PWAV, from 1
};

bool is_harmless(const std::string& operand) {
  return std::find(std::begin(kHarmless), std::end(kHarmless), operand) != std::end(kHarmless);
}

/// Wavelengths, in um in the file. They are kept for the record; no dispersion is computed.
/// False when the operand is none of them.
bool Reader::header_wavelength(const ZemaxLine& line) {
  constexpr double kMicrometer = 1e-6;
  constexpr std::size_t kMost = 24;  // as Zemax has
  if (line.operand == "PWAV") {
    primary_ = line.integer_at(0, "number");
  } else if (line.operand == "WAVM") {
    // Zemax writes all 24 of them, the unused ones as 0.55 with weight 1; their number is in no
    // operand we read.
    const double length = line.number_at(1, "wavelength");
    if (!(length > 0 && length < 1e4)) line.refuse("wavelength must be positive, in um");
    if (file_.wavelengths.size() < kMost) file_.wavelengths.push_back(length * kMicrometer);
  } else if (line.operand == "WAVL" || line.operand == "WAVN") {
    for (std::size_t i = 0; i < line.words.size() && file_.wavelengths.size() < kMost; ++i) {
      file_.wavelengths.push_back(line.number_at(i, "wavelength") * kMicrometer);
    }
  } else {
    return false;
  }
  return true;
}

/// Operands before the first surface, or between surfaces without indentation.
/// An operand that is not known is refused rather than skipped: it might bend light.
void Reader::header(const ZemaxLine& line) {
  const std::string& operand = line.operand;
  if (operand == "MODE") {
    if (line.words.empty() || line.words[0] != "SEQ")
      line.refuse("only sequential files (SEQ) are supported");
  } else if (operand == "UNIT") {
    if (unit_used_) line.refuse("stands behind lengths that need it");
    unit_ = meters_per_unit(line);
  } else if (operand == "NAME") {
    file_.title = line.rest;
  } else if (operand == "ENPD") {
    const double diameter = line.number_at(0, "diameter");
    if (!(diameter > 0)) line.refuse("diameter must be positive");
    file_.entrance_pupil_diameter = diameter * unit_;
    unit_used_ = true;
  } else if (operand == "MNUM") {
    if (line.integer_at(0, "number of configurations") > 1)
      line.refuse("several configurations are not supported");
  } else if (!header_wavelength(line) && !is_harmless(operand)) {
    line.refuse("this operand is not supported");
  }
}

/// Surfaces are numbered from 0 without gaps: 0 is the object, the last the image.
/// A file with gaps was cut or edited by hand, and every distance behind the gap would be wrong.
void Reader::begin_surface(const ZemaxLine& line) {
  if (line.integer_at(0, "number") != number() + 1) {
    line.refuse("surface " + std::to_string(number() + 1) + " was expected");
  }
  if (file_.surfaces.size() >= kMostSurfaces) line.refuse("too many surfaces");
  file_.surfaces.emplace_back();
  file_.comments.emplace_back();
  file_.breaks.emplace_back();
  type_ = Type::standard;
  diameter_ = 0;
  unit_used_ = true;
}

/// PARM of coordinate breaks: decenter x, y; tilts about x, y, z in degrees; order flag.
void Reader::break_parameter(int which, double value, const ZemaxLine& line) {
  constexpr double kDegree = std::numbers::pi / 180;
  ZemaxBreak& made = *file_.breaks.back();
  if (which == 1 || which == 2) {
    made.decenter[which - 1] = value * unit_;
  } else if (which >= 3 && which <= 5) {
    made.tilt[which - 3] = value * kDegree;
  } else if (which == 6) {
    made.tilt_first = true;
  } else {
    line.refuse("a coordinate break has no PARM " + std::to_string(which));
  }
}

/// PARM of biconic surfaces: radius and conic constant of the section along x; CURV and CONI are
/// those along y. A radius of 0 stands for a plane.
void Reader::biconic_parameter(int which, double value, const ZemaxLine& line) {
  if (which == 1) {
    surface().radius = value * unit_;
  } else if (which == 2) {
    surface().conic = value;
  } else {
    line.refuse("a biconic surface has no PARM " + std::to_string(which));
  }
}

/// PARM of even aspheres (EVENASPH), and of the types above.
/// A value of zero is accepted on any surface, as it changes nothing.
void Reader::parameter(const ZemaxLine& line) {
  const int which = line.integer_at(0, "number");
  const double value = line.number_at(1, "value");
  if (value == 0) return;
  if (type_ == Type::coordinate_break) return break_parameter(which, value, line);
  if (type_ == Type::biconic) return biconic_parameter(which, value, line);
  if (type_ == Type::standard)
    line.refuse("a standard surface has no parameters (TYPE must come before PARM)");
  if (which < 2 || which > 5) {
    line.refuse("only the terms of r^4 to r^10 (PARM 2 to 5) are supported, PARM " +
                std::to_string(which) + " is not zero");
  }
  // PARM k is the coefficient of r^(2k), in (lens unit)^(1 - 2k); PARM 1, of r^2, is excluded
  // above.
  const int power = 2 * which;
  surface().aspheric[static_cast<std::size_t>(which - 2)] = value * std::pow(unit_, 1 - power);
}

/// Operands of a surface's form, position and medium. False for others.
bool Reader::surface_shape(const ZemaxLine& line) {
  const std::string& operand = line.operand;
  if (operand == "TYPE") {
    const std::string type = line.words.empty() ? "" : line.words[0];
    if (type == "STANDARD") {
      type_ = Type::standard;
    } else if (type == "EVENASPH") {
      type_ = Type::asphere;
    } else if (type == "BICONICX") {
      type_ = Type::biconic;
      surface().radius_y = std::numeric_limits<double>::infinity();  // as its x, without CURV
    } else if (type == "COORDBRK") {
      if (number() == 0) line.refuse("the object cannot be a coordinate break");
      type_ = Type::coordinate_break;
      file_.breaks.back() = ZemaxBreak{};
    } else {
      line.refuse("surface type \"" + type.substr(0, 20) +
                  "\" is not supported, only STANDARD, EVENASPH, BICONICX and COORDBRK are");
    }
  } else if (operand == "CURV") {
    // CURV is 1 / R in 1 / (lens unit).
    const double curvature = line.number_at(0, "curvature");
    double& radius = type_ == Type::biconic ? surface().radius_y : surface().radius;
    radius = curvature == 0 ? std::numeric_limits<double>::infinity() : unit_ / curvature;
  } else if (operand == "CONI") {
    double& conic = type_ == Type::biconic ? surface().conic_y : surface().conic;
    conic = line.number_at(0, "conic constant");
  } else if (operand == "PARM") {
    parameter(line);
  } else if (operand == "DISZ") {
    const bool infinite = !line.words.empty() && line.words[0] == "INFINITY";
    surface().thickness =
        infinite ? std::numeric_limits<double>::infinity() : line.number_at(0, "distance") * unit_;
  } else if (operand == "GLAS") {
    surface().index = index_of(line);
  } else {
    return false;
  }
  return true;
}

/// Operands of the stop and of rims; DIAM and CLAP are semi-diameters in lens units. False for
/// others.
bool Reader::surface_edge(const ZemaxLine& line) {
  const std::string& operand = line.operand;
  if (operand == "STOP") {
    if (file_.stop != 0) line.refuse("there is a stop already");
    if (number() == 0) line.refuse("the object cannot be the stop");
    file_.stop = number();
  } else if (operand == "DIAM") {
    diameter_ = line.number_at(0, "semi-diameter") * unit_;
    if (diameter_ < 0) line.refuse("semi-diameter must not be negative");
    // Second word: 1 for a diameter fixed by the user; else Zemax computed it from its rays, and it
    // clips nothing.
    const bool fixed = line.words.size() > 1 && line.integer_at(1, "flag") == 1;
    if (fixed && diameter_ > 0) surface().semi_diameter = diameter_;
  } else if (operand == "CLAP") {
    if (line.number_at(0, "inner radius") != 0)
      line.refuse("an aperture with a hole in it is not supported");
    const double radius = line.number_at(1, "outer radius") * unit_;
    if (!(radius > 0)) line.refuse("outer radius must be positive");
    surface().semi_diameter = radius;
  } else if (operand == "FLAP") {
    if (diameter_ > 0) surface().semi_diameter = diameter_;
  } else {
    return false;
  }
  if (file_.stop == number() && number() > 0 && diameter_ > 0) file_.stop_radius = diameter_;
  return true;
}

/// Refuses every operand that could change the light and is not supported.
void Reader::in_surface(const ZemaxLine& line) {
  if (line.operand == "COMM") {
    file_.comments.back() = line.rest;
  } else if (!surface_shape(line) && !surface_edge(line) && !is_harmless(line.operand)) {
    line.refuse("this operand of surface " + std::to_string(number()) + " is not supported");
  }
}

/// Indentation alone tells a surface's operand from one of the header.
ZemaxFile Reader::read(std::string_view bytes) {
  const auto lines = detail::zemax_lines(bytes);
  for (const ZemaxLine& line : lines) {
    if (line.operand == "SURF") {
      begin_surface(line);
    } else if (!file_.surfaces.empty() && line.indented) {
      in_surface(line);
    } else {
      header(line);
    }
  }
  finish();
  return std::move(file_);
}

/// PWAV counts from 1, and may name a wavelength that the file does not list.
void Reader::finish() {
  if (file_.surfaces.size() < 3) {
    throw std::invalid_argument(
        "line 1: SURF: a lens needs an object, a surface and an image; there are " +
        std::to_string(file_.surfaces.size()) + " surfaces");
  }
  const int count = static_cast<int>(file_.wavelengths.size());
  file_.primary_wavelength = std::clamp(primary_ - 1, 0, std::max(0, count - 1));
}

}  // namespace

ZemaxFile parse_zemax(std::string_view bytes) { return Reader{}.read(bytes); }

}  // namespace vitreo::optics
