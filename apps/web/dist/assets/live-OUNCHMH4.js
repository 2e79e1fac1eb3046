import{a,b,c}from"./chunk-AEHGODYN.js";import"./chunk-BQWU73FJ.js";import"./chunk-WE7DCKMN.js";export{c as Live,b as LiveFigures,a as WALL};
