# The few commands a person needs; CMake does the work. `make help` lists them.
PRESET ?= release
BUILD  := build/$(PRESET)
SUDO   := $(shell [ "$$(id -u)" = 0 ] || echo sudo)

.PHONY: help setup build run test test-long bench asan tsan fuzz format format-check tidy clean
help:            ## this list
	@grep -hE '^[a-z-]+: .*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 16

setup:           ## install the Debian packages that are missing (packages.txt)
	@SUDO="$(SUDO)" sh cmake/install_packages.sh packages.txt

$(BUILD)/CMakeCache.txt: | setup
	cmake --preset $(PRESET)

build: setup $(BUILD)/CMakeCache.txt ## configure and build (PRESET=release|dev|asan|tsan)
	cmake --build --preset $(PRESET)

run: setup $(BUILD)/CMakeCache.txt ## drive the simulated microrobot round the square of the thesis' figure 6.5
	cmake --build --preset $(PRESET) --target vitreo
	$(BUILD)/vitreo run protocols/servo_square.lua

test: build      ## build and run every test
	ctest --preset $(PRESET)

test-long: build ## the long forms: 200 kills, thousands of broken files; prints distributions
	ctest --test-dir $(BUILD) -C long -L long --verbose

bench: build     ## print the figures of the loop and of its parts
	sh tests/bench/run.sh $(BUILD)

asan:            ## every test under the address and undefined-behaviour sanitizers
	$(MAKE) test PRESET=asan

tsan:            ## every test under the thread sanitizer
	$(MAKE) test PRESET=tsan

SECONDS ?= 30
fuzz: setup      ## feed every parser of outside bytes with random ones (SECONDS=30 each; clang)
	cmake --preset fuzz
	cmake --build build/fuzz --target fuzzers
	sh tests/fuzz/run.sh build/fuzz/tests/fuzz $(SECONDS)

SOURCES = $(shell git ls-files -co --exclude-standard '*.cpp' '*.h')
format:          ## lay out the C++ sources
	clang-format -i $(SOURCES)
format-check:    ## fail where the layout differs
	clang-format --dry-run --Werror $(SOURCES)
tidy: build      ## clang-tidy over our own sources
	sh cmake/tidy.sh $(BUILD)

clean:           ## remove the build folders
	rm -rf build
