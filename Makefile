# Runs from a fresh clone: each goal first checks the machine (scripts/setup.sh, under a second when nothing lacks).
# Everything is built with --release, the only profile in use, so that Bevy is compiled once.
# CARGO_TARGET_DIR, ARGS (options of the tool or of the tests) and CARGO_FLAGS (--locked, --offline) are honoured.

SHELL := /bin/bash
CARGO ?= cargo
CARGO_FLAGS ?=
ARGS ?=
FILE ?=

# rustup's folder last: a toolchain that is already on the path wins.
export PATH := $(PATH):$(HOME)/.cargo/bin

ifeq ($(shell uname -s),Linux)
# Bevy's wgpu would also try GLES, which cannot run the compute passes.
WGPU_BACKEND ?= vulkan
export WGPU_BACKEND
endif

# Mesa's software driver, asked for when the goal runs, since setup may have just installed it.
LAVAPIPE = $(shell ls /usr/share/vulkan/icd.d/lvp_icd.$$(uname -m).json /usr/share/vulkan/icd.d/lvp_icd.json \
	/etc/vulkan/icd.d/lvp_icd.$$(uname -m).json /etc/vulkan/icd.d/lvp_icd.json 2>/dev/null | head -n 1)

.DEFAULT_GOAL := help
.PHONY: help setup fly view test

help: ## shows this list
	@echo "bevy_treeline: forests drawn as points"
	@echo
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1\t\2/p' $(firstword $(MAKEFILE_LIST)) | expand -t 16
	@echo
	@echo "  make fly ARGS=--help shows the options of the flythrough."

setup: ## checks compiler, Rust and Vulkan; installs what lacks on Debian and Ubuntu
	@scripts/setup.sh

fly: setup ## flies over a landscape of trees (ARGS=..)
	$(CARGO) run --release $(CARGO_FLAGS) --features app -- fly $(ARGS)

view: setup ## shows one tree: make view FILE=tree.glb (ARGS=..)
	@test -n "$(FILE)" || { echo "make view needs a model: make view FILE=tree.glb" >&2; exit 2; }
	$(CARGO) run --release $(CARGO_FLAGS) --features app -- view "$(FILE)" $(ARGS)

# On the software driver where there is one, so that the same pictures come out on every machine; a GPU test without
# any adapter fails instead of being skipped. Newer loaders read VK_DRIVER_FILES, older ones VK_ICD_FILENAMES.
test: setup ## runs every test, the GPU ones on Mesa's software driver
	$(if $(LAVAPIPE),VK_DRIVER_FILES=$(LAVAPIPE) VK_ICD_FILENAMES=$(LAVAPIPE)) REQUIRE_GPU=1 \
		$(CARGO) test --release $(CARGO_FLAGS) --all-features $(ARGS)
