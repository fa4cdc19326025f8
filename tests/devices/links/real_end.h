// An emulator at the far end of a real wire (a pseudo-terminal, a TCP port), kept going by a thread
// of its own.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/peer_end.h"

#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

namespace vitreo {

class RealEnd {
 public:
  RealEnd(BytePeer& peer, std::unique_ptr<PeerEnd> end)
      : peer_(peer), end_(std::move(end)), address_(end_->address()), thread_([this] { run(); }) {}
  ~RealEnd() { hang_up(); }
  RealEnd(const RealEnd&) = delete;
  RealEnd& operator=(const RealEnd&) = delete;

  const std::string& address() const { return address_; }
  /// Looks at the emulator while its thread does not.
  template <class Look>
  auto look(const Look& work) {
    const std::lock_guard lock(mutex_);
    return work();
  }
  Time now() const {
    return std::chrono::duration_cast<Time>(std::chrono::steady_clock::now() - born_);
  }
  /// Pulls the cable.
  void hang_up() {
    ended_ = true;
    if (thread_.joinable()) thread_.join();
    end_.reset();
  }

 private:
  void run() {
    while (!ended_) {
      {
        const std::lock_guard lock(mutex_);
        end_->pump(peer_, now());
      }
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
  }

  BytePeer& peer_;
  std::unique_ptr<PeerEnd> end_;
  const std::string address_;
  const std::chrono::steady_clock::time_point born_ = std::chrono::steady_clock::now();
  std::mutex mutex_;
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

}  // namespace vitreo
