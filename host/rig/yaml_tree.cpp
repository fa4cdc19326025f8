// SPDX-License-Identifier: Apache-2.0
#include "host/rig/yaml_tree.h"

#include <optional>
#include <sstream>
#include <stdexcept>
#include <utility>
#include <yaml-cpp/anchor.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

namespace vitreo {
namespace {

using Kind = YamlNode::Kind;

[[noreturn]] void fail_at(int line, const std::string& what) {
  throw std::invalid_argument("line " + std::to_string(line) + ": " + what);
}

int line_of(const YAML::Mark& mark) { return mark.is_null() ? 1 : mark.line + 1; }

/// Builds the tree from yaml-cpp's events and not from its own nodes, because those lose duplicate
/// keys, share what aliases refer to, and are complete before anything can be counted.
class TreeBuilder : public YAML::EventHandler {
 public:
  explicit TreeBuilder(const YamlBounds& bounds) : bounds_(bounds) {}

  YamlNode take_root() { return std::exchange(root_, {}); }

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    put({Kind::null, line_of(mark), {}, {}, {}}, anchor);
  }
  void OnScalar(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                const std::string& value) override {
    put({Kind::scalar, line_of(mark), value, {}, {}}, anchor);
  }
  // A copy of what the anchor stands for, counted as such: ten levels of ten aliases each would
  // otherwise make 10^10 values of a short text. yaml-cpp announces an anchor at its beginning; one
  // that is used within itself has no node yet.
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    const auto named = anchors_.find(anchor);
    if (named == anchors_.end()) fail_at(line_of(mark), "an alias within its own anchor");
    count(named->second.nodes, line_of(mark));
    add(named->second);
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    open(Kind::sequence, mark, anchor);
  }
  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    open(Kind::mapping, mark, anchor);
  }
  void OnSequenceEnd() override { close(); }
  void OnMapEnd() override { close(); }

 private:
  // Containers that have begun and not ended, the outermost first. A node joins its parent only
  // when it is complete.
  struct Open {
    YamlNode node;
    YAML::anchor_t anchor;
    std::optional<std::string> key;  // of a mapping: read, and its value not yet
  };

  // Before the memory is taken: a text at the bound ends here, not in the allocator.
  void count(std::size_t nodes, int line) {
    count_ += nodes;
    if (count_ > bounds_.nodes)
      fail_at(line, "more than " + std::to_string(bounds_.nodes) + " values");
  }

  // Copies and destructors of a tree recurse, and yaml-cpp's parser does: what is thrown here ends
  // both before the stack does.
  void open(Kind kind, const YAML::Mark& mark, YAML::anchor_t anchor) {
    count(1, line_of(mark));
    if (static_cast<int>(open_.size()) >= bounds_.depth)
      fail_at(line_of(mark), "nested too deeply");
    open_.push_back({{kind, line_of(mark), {}, {}, {}}, anchor, {}});
  }

  void close() {
    Open done = std::move(open_.back());
    open_.pop_back();
    keep(std::move(done.node), done.anchor);
  }

  void put(YamlNode node, YAML::anchor_t anchor) {
    count(1, node.line);
    keep(std::move(node), anchor);
  }

  // By value: aliases copy it later, when its parent may have grown and moved.
  void keep(YamlNode node, YAML::anchor_t anchor) {
    if (anchor != YAML::NullAnchor) anchors_[anchor] = node;
    add(std::move(node));
  }

  // Into the innermost open node. Of a mapping keys and values come in turn.
  void add(YamlNode node) {
    if (open_.empty()) {
      root_ = std::move(node);
      return;
    }
    Open& parent = open_.back();
    parent.node.nodes += node.nodes;
    if (parent.node.kind == Kind::sequence) {
      parent.node.items.push_back(std::move(node));
    } else if (!parent.key) {
      if (node.kind != Kind::scalar || node.scalar.empty())
        fail_at(node.line, "a key without a name");
      if (parent.node.members.contains(node.scalar))
        fail_at(node.line, "'" + node.scalar.substr(0, 40) + "' is given twice");
      parent.key = std::move(node.scalar);
    } else {
      parent.node.members.emplace(*std::exchange(parent.key, {}), std::move(node));
    }
  }

  YamlBounds bounds_;
  YamlNode root_;
  std::vector<Open> open_;
  std::map<YAML::anchor_t, YamlNode> anchors_;
  std::size_t count_ = 0;
};

/// yaml-cpp takes byte 4 for the end of the text, and NUL for a sign of UTF-16: a file that is no
/// text could be read in part.
void refuse_control_characters(std::string_view text) {
  int line = 1;
  for (const char c : text) {
    if (c == '\n') ++line;
    if (static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\r' && c != '\t')
      fail_at(line, "a control character: not a text file");
  }
}

}  // namespace

const YamlNode* YamlNode::find(const std::string& key) const {
  const auto found = members.find(key);
  return found == members.end() ? nullptr : &found->second;
}

// The second document is asked for, because yaml-cpp would silently read the first alone: a
// calibration that was appended to another is an error.
YamlNode parse_yaml(std::string_view text, const YamlBounds& bounds) {
  if (text.size() > bounds.bytes)
    fail_at(1, "the file is larger than " + std::to_string(bounds.bytes >> 20) + " MiB");
  refuse_control_characters(text);
  std::istringstream stream{std::string(text)};
  try {
    YAML::Parser parser(stream);
    TreeBuilder builder(bounds);
    if (!parser.HandleNextDocument(builder)) return {};
    YamlNode root = builder.take_root();
    if (parser.HandleNextDocument(builder)) {
      const YamlNode second = builder.take_root();
      if (second.kind != Kind::null) fail_at(second.line, "a second document");
    }
    return root;
  } catch (const YAML::Exception& error) {
    fail_at(line_of(error.mark), error.msg);
  }
}

}  // namespace vitreo
