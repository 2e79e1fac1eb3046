import{a,b,c}from"./chunk-J6VXGAJB.js";import"./chunk-KVB2AAWX.js";import"./chunk-W7GJXGHH.js";export{c as Live,b as LiveFigures,a as WALL};
