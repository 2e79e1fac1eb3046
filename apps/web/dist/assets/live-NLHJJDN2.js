import{a,b,c}from"./chunk-OCX3MKYY.js";import"./chunk-BYS67ZI7.js";import"./chunk-QCCI4MMF.js";export{c as Live,b as LiveFigures,a as WALL};
